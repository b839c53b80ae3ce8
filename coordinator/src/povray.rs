//! Scenes in POV-Ray's language: the same picture from an independent program.
//!
//! POV-Ray's world is left-handed as the image model's is, its camera vectors mean the
//! same, and its `map_type 1` is the model's mapping for pole +y, equator +x; a matrix
//! brings it to any other. Radiance is linear and unattenuated in both. What differs:
//! POV-Ray keeps tolerances (surfaces closer than about 1e-3 to a shadow ray's start
//! are missed), and clamps what it writes.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use glam::DVec3;
use tessera_core::scene::{Orientation, Pigment, PlanePosition, Rgb, Scene, SurfaceId, Texture};
use tessera_core::settings::{Settings, Transfer};

/// Writes `name`.pov and the pictures it uses, as pixmaps, into `folder`; returns the scene's path.
///
/// POV-Ray finds the pictures when it runs inside `folder`. Its output must be written with
/// `File_Gamma=1.0` to be linear; size is for its command line. Samples are not exported.
///
/// # Errors
/// What writing files can meet.
pub fn export(scene: &Scene, settings: &Settings, folder: &Path, name: &str) -> io::Result<PathBuf> {
    for (i, picture) in scene.textures().iter().enumerate() {
        let mut out = BufWriter::new(File::create(folder.join(picture_file(name, i)))?);
        write_ppm(picture, &mut out)?;
        out.flush()?;
    }
    let path = folder.join(format!("{name}.pov"));
    let mut out = BufWriter::new(File::create(&path)?);
    write_scene(scene, settings, name, &mut out)?;
    out.flush()?;
    Ok(path)
}

fn picture_file(name: &str, index: usize) -> String {
    format!("{name}-{index}.ppm")
}

fn write_ppm(picture: &Texture, out: &mut impl Write) -> io::Result<()> {
    write!(out, "P6\n{} {}\n{}\n", picture.width(), picture.height(), picture.maxval())?;
    match picture.bytes() {
        Some(bytes) => out.write_all(bytes),
        None => picture.words().unwrap_or_default().iter().try_for_each(|w| out.write_all(&w.to_be_bytes())),
    }
}

fn vector(v: DVec3) -> String {
    format!("<{:e},{:e},{:e}>", v.x, v.y, v.z)
}

/// An object, as far as writing it in document order needs.
enum Object {
    Plane(usize),
    Sphere(usize),
    Triangle(usize),
}

fn write_scene(scene: &Scene, settings: &Settings, name: &str, out: &mut impl Write) -> io::Result<()> {
    let view = &settings.view;
    writeln!(
        out,
        "#version 3.7;\nglobal_settings {{ assumed_gamma 1 max_trace_level {} adc_bailout 0 ambient_light 0 }}\n\
         #default {{ finish {{ ambient 0 }} }}",
        // POV-Ray's own limit.
        settings.max_depth.min(256)
    )?;
    let camera = scene.camera();
    let width = view.plane_height() * f64::from(view.width()) / f64::from(view.height());
    writeln!(
        out,
        "camera {{ perspective location {} sky {} direction <0,0,{:e}> up <0,{:e},0> right <{width:e},0,0> look_at {} }}",
        vector(camera.location()),
        vector(camera.sky()),
        view.zoom(),
        view.plane_height(),
        vector(camera.look_at()),
    )?;
    let writer = Writer { scene, transfer: settings.transfer, name };
    writeln!(out, "background {{ rgb {} }}", writer.color(scene.background()))?;
    for &light in scene.lights() {
        writeln!(out, "light_source {{ {} rgb 1 }}", vector(light))?;
    }
    for i in 0..scene.surfaces().len() {
        let id = SurfaceId(u32::try_from(i).map_err(io::Error::other)?);
        if matches!(scene.surface(id).pigment, Pigment::Color(_)) {
            writeln!(out, "#declare T{i} = {}", writer.texture(id, None))?;
        }
    }
    writer.objects(out)
}

struct Writer<'a> {
    scene: &'a Scene,
    transfer: Transfer,
    name: &'a str,
}

impl Writer<'_> {
    /// A colour as linear light, as POV-Ray takes it.
    fn color(&self, c: Rgb) -> String {
        let linear = |c: f64| match self.transfer {
            Transfer::Linear => c,
            Transfer::Srgb if c <= 0.04045 => c / 12.92,
            Transfer::Srgb => libm::pow((c + 0.055) / 1.055, 2.4),
        };
        let [r, g, b] = c.map(linear);
        vector(DVec3::new(r, g, b))
    }

    /// A texture; `place` is the matrix rows that bring POV-Ray's unit map onto the object.
    fn texture(&self, id: SurfaceId, place: Option<(u8, [DVec3; 4])>) -> String {
        let surface = self.scene.surface(id);
        let pigment = match surface.pigment {
            Pigment::Color(c) => format!("rgb {}", self.color(c)),
            Pigment::Texture(p) => {
                let gamma = if self.transfer == Transfer::Srgb { "srgb" } else { "1.0" };
                let file = picture_file(self.name, p.0 as usize);
                let (map, matrix) = place.unwrap_or((0, [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ZERO]));
                let matrix: Vec<String> = matrix.iter().flat_map(|v| v.to_array()).map(|x| format!("{x:e}")).collect();
                format!(
                    "image_map {{ ppm \"{file}\" gamma {gamma} map_type {map} interpolate 2 }} matrix <{}>",
                    matrix.join(", ")
                )
            }
        };
        format!(
            "texture {{ pigment {{ {pigment} }} finish {{ ambient 0 diffuse {:e} reflection {:e} }} }}",
            surface.diffuse, surface.reflect
        )
    }

    /// The texture of one object: declared where it is a colour, in place where it is a picture.
    fn of(&self, id: SurfaceId, place: impl FnOnce() -> (u8, [DVec3; 4])) -> String {
        match self.scene.surface(id).pigment {
            Pigment::Color(_) => format!("texture {{ T{} }}", id.0),
            Pigment::Texture(_) => self.texture(id, Some(place())),
        }
    }

    fn objects(&self, out: &mut impl Write) -> io::Result<()> {
        let scene = self.scene;
        let mut objects: Vec<(u32, Object)> = Vec::with_capacity(scene.object_count());
        objects.extend(scene.planes().iter().enumerate().map(|(i, p)| (p.order, Object::Plane(i))));
        objects.extend(scene.spheres().iter().enumerate().map(|(i, s)| (s.order, Object::Sphere(i))));
        objects.extend(scene.triangles().iter().enumerate().map(|(i, t)| (t.order, Object::Triangle(i))));
        objects.sort_unstable_by_key(|(order, _)| *order);
        // Triangles of one texture become one mesh: POV-Ray holds them far more compactly.
        let mut mesh: Option<SurfaceId> = None;
        for (_, object) in objects {
            let surface = match object {
                Object::Triangle(i) => Some(scene.triangles()[i].surface()),
                _ => None,
            };
            let pictured = surface.is_some_and(|s| matches!(scene.surface(s).pigment, Pigment::Texture(_)));
            if let Some(open) = mesh
                && (surface != Some(open) || pictured)
            {
                writeln!(out, "texture {{ T{} }} }}", open.0)?;
                mesh = None;
            }
            match object {
                Object::Plane(i) => self.plane(i, out)?,
                Object::Sphere(i) => self.sphere(i, out)?,
                Object::Triangle(i) => {
                    let t = &scene.triangles()[i];
                    let [a, b, c] = t.corners();
                    let corners = format!("triangle {{ {}, {}, {}", vector(a), vector(b), vector(c));
                    if pictured {
                        let n = (b - a).cross(c - a);
                        let place = || (0, [b - a, c - a, n, a]);
                        writeln!(out, "{corners} {} }}", self.of(t.surface(), place))?;
                    } else {
                        if mesh.is_none() {
                            writeln!(out, "mesh {{")?;
                            mesh = Some(t.surface());
                        }
                        writeln!(out, "{corners} }}")?;
                    }
                }
            }
        }
        match mesh {
            Some(open) => writeln!(out, "texture {{ T{} }} }}", open.0),
            None => Ok(()),
        }
    }

    fn sphere(&self, i: usize, out: &mut impl Write) -> io::Result<()> {
        let s = &self.scene.spheres()[i];
        let place = || {
            let default = Orientation { pole: DVec3::Y, equator: DVec3::X };
            let o = u32::try_from(i).ok().and_then(|i| self.scene.orientation(i)).unwrap_or(&default);
            let p = o.pole.normalize();
            let e = (o.equator - p * o.equator.dot(p)).normalize();
            (1, [e, p, e.cross(p), s.center])
        };
        writeln!(out, "sphere {{ {}, {:e} {} }}", vector(s.center), s.radius, self.of(s.surface, place))
    }

    fn plane(&self, i: usize, out: &mut impl Write) -> io::Result<()> {
        let p = &self.scene.planes()[i];
        let n = p.normal.normalize();
        let (distance, origin) = match p.position {
            PlanePosition::Distance(d) => (d, n * d),
            PlanePosition::Point(q) => (q.dot(n), q),
        };
        let place = || {
            let a = n.abs();
            let axis = match () {
                () if a.x <= a.y && a.x <= a.z => DVec3::X,
                () if a.y <= a.z => DVec3::Y,
                () => DVec3::Z,
            };
            let u = axis.cross(n).normalize();
            (0, [u, n.cross(u), n, origin])
        };
        writeln!(out, "plane {{ {}, {distance:e} {} }}", vector(n), self.of(p.surface, place))
    }
}
