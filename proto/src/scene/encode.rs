//! A scene into pieces of bytes.

use bytes::Bytes;
use glam::DVec3;
use sha2::{Digest, Sha256};
use tessera_core::scene::{Orientation, Pigment, PlanePosition, Scene, SurfaceId};

use super::{MAGIC, PLANE_DISTANCE, PLANE_POINT, SPHERE, SPHERE_ORIENTED, TRIANGLE_CORNERS, TRIANGLE_SIDES};
use crate::ids::SceneHash;

/// The hash and the length in bytes of `scene`'s binary form.
#[must_use]
pub fn describe(scene: &Scene) -> (SceneHash, u64) {
    let (mut hash, mut length) = (Sha256::new(), 0);
    for piece in SceneEncoder::new(scene, crate::limits::SCENE_PIECE_BYTES) {
        hash.update(&piece);
        length += piece.len() as u64;
    }
    (SceneHash(hash.finalize().into()), length)
}

/// The hash of `scene`'s binary form without the textures that its objects show, and that of the textures alone.
#[must_use]
pub fn describe_parts(scene: &Scene) -> (SceneHash, SceneHash) {
    let (mut plain, mut textures) = (Sha256::new(), Sha256::new());
    let mut encoder = SceneEncoder::new(scene, crate::limits::SCENE_PIECE_BYTES);
    let shown = std::mem::take(&mut encoder.used.textures);
    encoder.for_each(|piece| plain.update(&piece));
    for texture in shown.into_iter().map(|index| &scene.textures()[index]) {
        for n in [texture.width(), texture.height(), texture.maxval().into()] {
            textures.update(n.to_le_bytes());
        }
        textures.update(texture.bytes().unwrap_or_default());
        for words in texture.words().unwrap_or_default().chunks(1 << 12) {
            textures.update(words.iter().flat_map(|w| w.to_le_bytes()).collect::<Vec<u8>>());
        }
    }
    (SceneHash(plain.finalize().into()), SceneHash(textures.finalize().into()))
}

/// Pieces of a scene's binary form, each of the given length but for the last.
/// The same for equal scenes, whatever pieces are asked for.
#[derive(Debug)]
pub struct SceneEncoder<'s> {
    scene: &'s Scene,
    used: Used,
    piece_bytes: usize,
    /// Written and not yet given out: little more than one piece.
    buffer: Vec<u8>,
    at: At,
}

/// Objects of a run at most: bounds the buffer, and costs nothing beside their size.
const RUN_OBJECTS: usize = 1024;

/// What is written next.
#[derive(Clone, Copy, Debug)]
enum At {
    Head,
    Lights(usize),
    /// Of the used textures, and a sample of it.
    Texture(usize, usize),
    Surfaces(usize),
    /// The next of each kind, and of the orientations.
    Objects {
        plane: usize,
        sphere: usize,
        triangle: usize,
        orientation: usize,
    },
    Done,
}

/// Which surfaces and textures some object uses, and their new numbers.
#[derive(Debug)]
struct Used {
    surfaces: Vec<usize>,
    surface_numbers: Vec<u32>,
    textures: Vec<usize>,
    texture_numbers: Vec<u32>,
}

impl Used {
    fn of(scene: &Scene) -> Self {
        let mut surface_used = vec![false; scene.surfaces().len()];
        let mut mark = |id: SurfaceId| surface_used[id.0 as usize] = true;
        scene.planes().iter().for_each(|p| mark(p.surface));
        scene.spheres().iter().for_each(|s| mark(s.surface));
        scene.triangles().iter().for_each(|t| mark(t.surface()));
        let mut texture_used = vec![false; scene.textures().len()];
        for (surface, _) in scene.surfaces().iter().zip(&surface_used).filter(|(_, used)| **used) {
            if let Pigment::Texture(id) = surface.pigment {
                texture_used[id.0 as usize] = true;
            }
        }
        let (surfaces, surface_numbers) = renumber(&surface_used);
        let (textures, texture_numbers) = renumber(&texture_used);
        Self { surfaces, surface_numbers, textures, texture_numbers }
    }
}

/// The indices that are used, and for every index its number among them.
fn renumber(used: &[bool]) -> (Vec<usize>, Vec<u32>) {
    let mut kept = Vec::new();
    let numbers = used
        .iter()
        .enumerate()
        .map(|(i, &used)| {
            let number = kept.len() as u32;
            if used {
                kept.push(i);
            }
            number
        })
        .collect();
    (kept, numbers)
}

/// One object, whatever its kind.
#[derive(Clone, Copy)]
enum Object<'s> {
    Plane(&'s tessera_core::scene::Plane),
    Sphere(&'s tessera_core::scene::Sphere, Option<&'s Orientation>),
    Triangle(&'s tessera_core::scene::Triangle),
}

impl Object<'_> {
    fn kind(&self) -> u8 {
        match self {
            Self::Plane(p) if matches!(p.position, PlanePosition::Point(_)) => PLANE_POINT,
            Self::Plane(_) => PLANE_DISTANCE,
            Self::Sphere(_, None) => SPHERE,
            Self::Sphere(_, Some(_)) => SPHERE_ORIENTED,
            Self::Triangle(t) if t.by_sides() => TRIANGLE_SIDES,
            Self::Triangle(_) => TRIANGLE_CORNERS,
        }
    }

    fn surface(&self) -> SurfaceId {
        match self {
            Self::Plane(p) => p.surface,
            Self::Sphere(s, _) => s.surface,
            Self::Triangle(t) => t.surface(),
        }
    }
}

fn put_count(out: &mut Vec<u8>, mut n: u32) {
    while n >= 0x80 {
        out.push(n as u8 | 0x80);
        n >>= 7;
    }
    out.push(n as u8);
}

fn put(out: &mut Vec<u8>, numbers: &[f64]) {
    for n in numbers {
        out.extend_from_slice(&n.to_le_bytes());
    }
}

fn put_vec(out: &mut Vec<u8>, v: DVec3) {
    put(out, &v.to_array());
}

impl<'s> SceneEncoder<'s> {
    /// The pieces of `scene`, `piece_bytes` long each, at least 1.
    #[must_use]
    pub fn new(scene: &'s Scene, piece_bytes: usize) -> Self {
        let piece_bytes = piece_bytes.max(1);
        let buffer = Vec::with_capacity(piece_bytes.saturating_mul(2).min(2 << 20));
        Self { scene, used: Used::of(scene), piece_bytes, buffer, at: At::Head }
    }

    /// Writes until a piece is full or nothing is left.
    fn fill(&mut self) {
        while self.buffer.len() < self.piece_bytes {
            self.at = match self.at {
                At::Head => self.head(),
                At::Lights(from) => self.lights(from),
                At::Texture(texture, sample) => self.texture(texture, sample),
                At::Surfaces(from) => self.surfaces(from),
                At::Objects { plane, sphere, triangle, orientation } => {
                    self.objects(plane, sphere, triangle, orientation)
                }
                At::Done => return,
            };
        }
    }

    fn head(&mut self) -> At {
        let (s, out) = (self.scene, &mut self.buffer);
        out.extend_from_slice(MAGIC);
        // Ids of every kind are u32, so their numbers are too.
        for n in [
            s.lights().len(),
            self.used.textures.len(),
            self.used.surfaces.len(),
            s.planes().len(),
            s.spheres().len(),
            s.triangles().len(),
        ] {
            put_count(out, n as u32);
        }
        let camera = s.camera();
        for v in [camera.location(), camera.sky(), camera.look_at()] {
            put_vec(out, v);
        }
        put(out, &s.background());
        At::Lights(0)
    }

    fn lights(&mut self, from: usize) -> At {
        let lights = self.scene.lights();
        let to = lights.len().min(from + RUN_OBJECTS);
        lights[from..to].iter().for_each(|&light| put_vec(&mut self.buffer, light));
        if to == lights.len() { At::Texture(0, 0) } else { At::Lights(to) }
    }

    fn texture(&mut self, number: usize, sample: usize) -> At {
        let Some(&index) = self.used.textures.get(number) else { return At::Surfaces(0) };
        let (texture, out) = (&self.scene.textures()[index], &mut self.buffer);
        if sample == 0 {
            for n in [texture.width(), texture.height(), texture.maxval().into()] {
                put_count(out, n);
            }
        }
        let room = self.piece_bytes;
        let (to, length) = if let Some(bytes) = texture.bytes() {
            let to = bytes.len().min(sample + room);
            out.extend_from_slice(&bytes[sample..to]);
            (to, bytes.len())
        } else {
            let words = texture.words().unwrap_or_default();
            let to = words.len().min(sample + room / 2 + 1);
            out.extend(words[sample..to].iter().flat_map(|w| w.to_le_bytes()));
            (to, words.len())
        };
        if to == length { At::Texture(number + 1, 0) } else { At::Texture(number, to) }
    }

    fn surfaces(&mut self, from: usize) -> At {
        for (i, &index) in self.used.surfaces.iter().enumerate().skip(from) {
            if self.buffer.len() >= self.piece_bytes {
                return At::Surfaces(i);
            }
            let surface = &self.scene.surfaces()[index];
            put(&mut self.buffer, &[surface.diffuse, surface.reflect]);
            match surface.pigment {
                Pigment::Color(color) => {
                    self.buffer.push(0);
                    put(&mut self.buffer, &color);
                }
                Pigment::Texture(id) => {
                    self.buffer.push(1);
                    put_count(&mut self.buffer, self.used.texture_numbers[id.0 as usize]);
                }
            }
        }
        At::Objects { plane: 0, sphere: 0, triangle: 0, orientation: 0 }
    }

    /// Writes one run: objects that follow each other in the document and share kind and
    /// surface, up to [`RUN_OBJECTS`].
    fn objects(&mut self, mut plane: usize, mut sphere: usize, mut triangle: usize, mut orientation: usize) -> At {
        let s = self.scene;
        let next = |plane: usize, sphere: usize, triangle: usize, orientation: usize| {
            let mut first: Option<(u32, Object<'s>)> =
                s.triangles().get(triangle).map(|t| (t.order, Object::Triangle(t)));
            let mut consider = |order: u32, object: Object<'s>| {
                if first.as_ref().is_none_or(|(o, _)| order < *o) {
                    first = Some((order, object));
                }
            };
            if let Some(b) = s.spheres().get(sphere) {
                let of_it = s.orientations().get(orientation).filter(|(i, _)| *i as usize == sphere);
                consider(b.order, Object::Sphere(b, of_it.map(|(_, o)| o)));
            }
            if let Some(p) = s.planes().get(plane) {
                consider(p.order, Object::Plane(p));
            }
            first.map(|(_, object)| object)
        };
        let Some(first) = next(plane, sphere, triangle, orientation) else { return At::Done };
        let (kind, surface) = (first.kind(), first.surface());
        let start = self.buffer.len();
        let mut length = 0;
        let mut object = Some(first);
        while let Some(o) = object.filter(|o| length < RUN_OBJECTS && o.kind() == kind && o.surface() == surface) {
            let out = &mut self.buffer;
            match o {
                Object::Plane(p) => {
                    put_vec(out, p.normal);
                    match p.position {
                        PlanePosition::Point(point) => put_vec(out, point),
                        PlanePosition::Distance(d) => put(out, &[d]),
                    }
                    plane += 1;
                }
                Object::Sphere(b, oriented) => {
                    put_vec(out, b.center);
                    put(out, &[b.radius]);
                    if let Some(o) = oriented {
                        put_vec(out, o.pole);
                        put_vec(out, o.equator);
                        orientation += 1;
                    }
                    sphere += 1;
                }
                Object::Triangle(t) => {
                    t.written.iter().for_each(|&v| put_vec(out, v));
                    triangle += 1;
                }
            }
            length += 1;
            object = next(plane, sphere, triangle, orientation);
        }
        // The run's length is known only now: its head goes before what was written.
        let mut head = Vec::with_capacity(11);
        head.push(kind);
        put_count(&mut head, self.used.surface_numbers[surface.0 as usize]);
        put_count(&mut head, length as u32);
        self.buffer.splice(start..start, head);
        At::Objects { plane, sphere, triangle, orientation }
    }
}

impl Iterator for SceneEncoder<'_> {
    type Item = Bytes;

    fn next(&mut self) -> Option<Bytes> {
        self.fill();
        if self.buffer.is_empty() {
            return None;
        }
        let length = self.piece_bytes.min(self.buffer.len());
        let rest = self.buffer.split_off(length);
        let piece = std::mem::replace(&mut self.buffer, Vec::with_capacity(self.piece_bytes.min(1 << 20) + 4096));
        self.buffer.extend_from_slice(&rest);
        Some(Bytes::from(piece))
    }
}
