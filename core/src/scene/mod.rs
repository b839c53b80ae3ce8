//! The resolved scene: immutable, and unable to hold a bad value.
//!
//! A [`Scene`] is made by a [`SceneBuilder`], which refuses whatever the format's
//! semantic checks refuse; whoever holds a `Scene`, read from XML or received
//! from a peer, need check nothing again. All lengths are in scene units, all
//! vectors as written: nothing is normalised, rounded or moved here.

mod builder;
pub mod pixmap;
pub(crate) mod rules;
mod texture;

pub use builder::{Invalid, SceneBuilder};
pub use texture::{Texture, TextureError};

use glam::DVec3;

/// A colour's components as written, each in [0, 1]; encoded as the transfer says.
pub type Rgb = [f64; 3];

/// Index into [`Scene::surfaces`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SurfaceId(pub u32);

/// Index into [`Scene::textures`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct TextureId(pub u32);

/// Place of an object among all objects of its document; breaks ties between equal distances.
pub type Order = u32;

/// The eye: where it is, where it looks, which way is up. `look_at` ≠ `location`,
/// `sky` is neither zero nor parallel to the view direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    pub(crate) location: DVec3,
    pub(crate) sky: DVec3,
    pub(crate) look_at: DVec3,
}

impl Camera {
    /// The eye's place.
    #[must_use]
    pub fn location(&self) -> DVec3 {
        self.location
    }
    /// Up, of any length.
    #[must_use]
    pub fn sky(&self) -> DVec3 {
        self.sky
    }
    /// The point in the picture's middle.
    #[must_use]
    pub fn look_at(&self) -> DVec3 {
        self.look_at
    }
}

/// What a surface does with light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Share of light scattered, in [0, 1].
    pub diffuse: f64,
    /// Share of light mirrored, in [0, 1].
    pub reflect: f64,
    /// Colour of what is scattered.
    pub pigment: Pigment,
}

/// A surface's colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pigment {
    /// The same everywhere.
    Color(Rgb),
    /// Taken from a picture.
    Texture(TextureId),
}

impl Default for Surface {
    /// Matte white, as where a scene says nothing.
    fn default() -> Self {
        Self { diffuse: 1.0, reflect: 0.0, pigment: Pigment::Color([1.0; 3]) }
    }
}

/// Where an infinite plane lies along its normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PlanePosition {
    /// Through this point.
    Point(DVec3),
    /// This far from the origin along the unit normal.
    Distance(f64),
}

/// An infinite plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Not zero; any length, only its direction counts.
    pub normal: DVec3,
    /// Where it lies.
    pub position: PlanePosition,
    /// What it does with light.
    pub surface: SurfaceId,
    /// Its place in the document.
    pub order: Order,
}

/// A sphere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sphere {
    /// Its centre.
    pub center: DVec3,
    /// Above 0.
    pub radius: f64,
    /// What it does with light.
    pub surface: SurfaceId,
    /// Its place in the document.
    pub order: Order,
}

/// How a picture lies on a sphere: neither zero nor parallel, any length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orientation {
    /// Where the picture's top edge gathers.
    pub pole: DVec3,
    /// Where the picture's left edge runs.
    pub equator: DVec3,
}

/// A flat triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangle {
    /// Corner c0, then c1 and c2, or the sides v1 and v2, as [`Triangle::by_sides`] says.
    /// Kept as written, since c0 + v1 need not be an f64.
    pub written: [DVec3; 3],
    surface_and_form: u32,
    /// Its place in the document.
    pub order: Order,
}

impl Triangle {
    const SIDES: u32 = 1 << 31;

    /// Whether the second and third vectors are sides rather than corners.
    #[must_use]
    pub fn by_sides(&self) -> bool {
        self.surface_and_form & Self::SIDES != 0
    }

    /// What it does with light.
    #[must_use]
    pub fn surface(&self) -> SurfaceId {
        SurfaceId(self.surface_and_form & !Self::SIDES)
    }

    /// The corners c0, c1, c2, where all of them are f64s, in whatever form they were written.
    pub(crate) fn exact_corners(&self) -> Option<[DVec3; 3]> {
        if !self.by_sides() {
            return Some(self.written);
        }
        let [a, b, c] = self.written;
        // What a sum leaves of its terms is found exactly; not a number where the sum overflows.
        let rest = |a: DVec3, b: DVec3| {
            let sum = a + b;
            let part = sum - a;
            (a - (sum - part)) + (b - part)
        };
        (rest(a, b) == DVec3::ZERO && rest(a, c) == DVec3::ZERO).then(|| [a, a + b, a + c])
    }

    /// The corners c0, c1, c2, each component rounded once to the nearest f64.
    #[must_use]
    pub fn corners(&self) -> [DVec3; 3] {
        let [a, b, c] = self.written;
        if self.by_sides() { [a, a + b, a + c] } else { [a, b, c] }
    }
}

/// A whole scene, resolved.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    camera: Camera,
    background: Rgb,
    lights: Vec<DVec3>,
    planes: Vec<Plane>,
    spheres: Vec<Sphere>,
    orientations: Vec<(u32, Orientation)>,
    triangles: Vec<Triangle>,
    surfaces: Vec<Surface>,
    pictures: Vec<Texture>,
}

impl Scene {
    /// The eye.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.camera
    }
    /// Colour where nothing is hit.
    #[must_use]
    pub fn background(&self) -> Rgb {
        self.background
    }
    /// Places of the point lights, in document order.
    #[must_use]
    pub fn lights(&self) -> &[DVec3] {
        &self.lights
    }
    /// Infinite planes, in document order.
    #[must_use]
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }
    /// Spheres, in document order.
    #[must_use]
    pub fn spheres(&self) -> &[Sphere] {
        &self.spheres
    }
    /// Triangles, in document order.
    #[must_use]
    pub fn triangles(&self) -> &[Triangle] {
        &self.triangles
    }
    /// Distinct surfaces; what objects' ids index.
    #[must_use]
    pub fn surfaces(&self) -> &[Surface] {
        &self.surfaces
    }
    /// The surface `id` names.
    #[must_use]
    pub fn surface(&self, id: SurfaceId) -> &Surface {
        &self.surfaces[id.0 as usize]
    }
    /// Pictures that some surface uses; what [`TextureId`]s index.
    #[must_use]
    pub fn textures(&self) -> &[Texture] {
        &self.pictures
    }
    /// The orientations of pictured spheres as (index into [`Scene::spheres`], orientation),
    /// by rising index: only spheres whose pigment is a picture have one.
    #[must_use]
    pub fn orientations(&self) -> &[(u32, Orientation)] {
        &self.orientations
    }
    /// The orientation of the picture on sphere `index`, if it has one.
    #[must_use]
    pub fn orientation(&self, index: u32) -> Option<&Orientation> {
        let at = self.orientations.binary_search_by_key(&index, |(i, _)| *i).ok()?;
        Some(&self.orientations[at].1)
    }
    /// Objects that rays can meet: planes, spheres and triangles.
    #[must_use]
    pub fn object_count(&self) -> usize {
        self.planes.len() + self.spheres.len() + self.triangles.len()
    }
}
