//! What one piece of a document holds: its objects and its findings.

use std::collections::HashMap;
use std::ops::Range;

use glam::DVec3;

use super::finding::{Findings, Limits};
use crate::scene::{Invalid, Orientation, Pigment, PlanePosition, SceneBuilder, Surface, SurfaceId, TextureId};

/// A pigment whose picture is not loaded yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Paint {
    Color([f64; 3]),
    /// Index into the part's files.
    File(u32),
}

/// A surface whose picture is not loaded yet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Finish {
    pub diffuse: f64,
    pub reflect: f64,
    pub paint: Paint,
}

impl Default for Finish {
    fn default() -> Self {
        Self { diffuse: 1.0, reflect: 0.0, paint: Paint::Color([1.0; 3]) }
    }
}

/// A triangle as written; `surface` counts the part's own surfaces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Triangle {
    pub written: [DVec3; 3],
    pub surface: u32,
    pub by_sides: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sphere {
    pub center: DVec3,
    pub radius: f64,
    pub orientation: Option<Orientation>,
    pub surface: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    pub normal: DVec3,
    pub position: PlanePosition,
    pub surface: u32,
}

/// One child of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Object {
    Triangle(Triangle),
    Sphere(Sphere),
    Plane(Plane),
    Light(DVec3),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sort {
    Triangle,
    Sphere,
    Plane,
}

/// Objects and findings of a piece, in document order.
#[derive(Debug)]
pub(super) struct Part {
    triangles: Vec<Triangle>,
    spheres: Vec<Sphere>,
    planes: Vec<Plane>,
    lights: Vec<DVec3>,
    /// How the three kinds that rays meet are interleaved.
    sequence: Vec<(Sort, u32)>,
    surfaces: Vec<Finish>,
    surface_ids: HashMap<[u64; 5], u32>,
    /// Pictures' file names and where each was first named.
    pub files: Vec<(String, Range<usize>)>,
    pub findings: Findings,
    /// Whether white space was seen between elements. The fast lane does not look.
    pub blank: bool,
}

impl Part {
    pub(super) fn new(limits: Limits) -> Self {
        Self {
            triangles: Vec::new(),
            spheres: Vec::new(),
            planes: Vec::new(),
            lights: Vec::new(),
            sequence: Vec::new(),
            surfaces: Vec::new(),
            surface_ids: HashMap::new(),
            files: Vec::new(),
            findings: Findings::new(limits),
            blank: false,
        }
    }

    /// The part's number for a surface, the same for equal ones.
    pub(super) fn surface(&mut self, finish: Finish) -> u32 {
        let paint = match finish.paint {
            Paint::Color(c) => c.map(f64::to_bits),
            Paint::File(file) => [u64::MAX, file.into(), 0],
        };
        let key = [finish.diffuse.to_bits(), finish.reflect.to_bits(), paint[0], paint[1], paint[2]];
        let surfaces = &mut self.surfaces;
        *self.surface_ids.entry(key).or_insert_with(|| {
            surfaces.push(finish);
            // A part holds far fewer surfaces than bytes of text, and its text is below 4 GiB.
            u32::try_from(surfaces.len() - 1).unwrap_or(u32::MAX)
        })
    }

    /// The part's number for a picture's file.
    pub(super) fn file(&mut self, name: &str, at: Range<usize>) -> u32 {
        let index = self.files.iter().rposition(|(known, _)| known == name).unwrap_or_else(|| {
            self.files.push((name.to_owned(), at));
            self.files.len() - 1
        });
        u32::try_from(index).unwrap_or(u32::MAX)
    }

    pub(super) fn push(&mut self, object: Object) {
        let sort = match object {
            Object::Triangle(t) => {
                self.triangles.push(t);
                Sort::Triangle
            }
            Object::Sphere(s) => {
                self.spheres.push(s);
                Sort::Sphere
            }
            Object::Plane(p) => {
                self.planes.push(p);
                Sort::Plane
            }
            Object::Light(l) => return self.lights.push(l),
        };
        match self.sequence.last_mut() {
            Some((last, count)) if *last == sort && *count < u32::MAX => *count += 1,
            _ => self.sequence.push((sort, 1)),
        }
    }

    /// Moves the objects into `scene`; `pictures` holds what the part's files became.
    pub(super) fn build(self, scene: &mut SceneBuilder, pictures: &[TextureId]) -> Result<(), Invalid> {
        let surfaces = self
            .surfaces
            .iter()
            .map(|f| {
                let pigment = match f.paint {
                    Paint::Color(c) => Pigment::Color(c),
                    Paint::File(i) => Pigment::Texture(*pictures.get(i as usize).ok_or(Invalid::Unknown(i))?),
                };
                scene.surface(Surface { diffuse: f.diffuse, reflect: f.reflect, pigment })
            })
            .collect::<Result<Vec<SurfaceId>, Invalid>>()?;
        let surface = |i: u32| surfaces.get(i as usize).copied().ok_or(Invalid::Unknown(i));
        let (mut triangles, mut spheres, mut planes) =
            (self.triangles.into_iter(), self.spheres.into_iter(), self.planes.into_iter());
        for (sort, count) in self.sequence {
            let count = count as usize;
            match sort {
                Sort::Triangle => {
                    for Triangle { written, surface: s, by_sides } in triangles.by_ref().take(count) {
                        if by_sides {
                            scene.triangle_by_sides(written[0], [written[1], written[2]], surface(s)?)?;
                        } else {
                            scene.triangle(written, surface(s)?)?;
                        }
                    }
                }
                Sort::Sphere => {
                    for s in spheres.by_ref().take(count) {
                        scene.sphere(s.center, s.radius, s.orientation, surface(s.surface)?)?;
                    }
                }
                Sort::Plane => {
                    for p in planes.by_ref().take(count) {
                        scene.plane(p.normal, p.position, surface(p.surface)?)?;
                    }
                }
            }
        }
        for light in self.lights {
            scene.light(light)?;
        }
        Ok(())
    }

    /// Triangles it holds.
    pub(super) fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Spheres it holds.
    pub(super) fn spheres(&self) -> usize {
        self.spheres.len()
    }

    /// Whether it holds a light.
    pub(super) fn lit(&self) -> bool {
        !self.lights.is_empty()
    }
}
