//! The only way to a [`Scene`]: every value is checked on its way in.

use std::collections::HashMap;

use glam::DVec3;

use super::rules::{self, finite};
use super::{
    Camera, Order, Orientation, Pigment, Plane, PlanePosition, Rgb, Scene, Sphere, Surface, SurfaceId, Texture,
    TextureId, Triangle,
};
use crate::simd::roomy;

/// As many as a leaf of the hierarchy can name.
const MOST_OBJECTS: u32 = 1 << 27;

/// A value that the format's semantic checks refuse.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Invalid {
    /// Not a finite number.
    #[error("a number is not finite")]
    NotFinite,
    /// Colour component, diffuse or reflect outside [0, 1].
    #[error("{0} is not in [0, 1]")]
    NotAShare(f64),
    /// Radius not above 0.
    #[error("radius {0} is not above 0")]
    Radius(f64),
    /// A plane needs a direction.
    #[error("the normal is zero")]
    ZeroNormal,
    /// The eye looks at itself.
    #[error("look_at equals location")]
    NoView,
    /// Up has no direction.
    #[error("sky is zero")]
    ZeroSky,
    /// Up is along the view.
    #[error("sky is parallel to the view direction")]
    SkyParallel,
    /// Pole or equator without direction.
    #[error("pole or equator is zero")]
    ZeroOrientation,
    /// Pole along equator.
    #[error("pole and equator are parallel")]
    OrientationParallel,
    /// More objects, surfaces or pictures than ids.
    #[error("too many objects, surfaces or pictures")]
    TooMany,
    /// A surface or picture that was not added before.
    #[error("unknown surface or picture {0}")]
    Unknown(u32),
    /// A camera was never given.
    #[error("the scene has no camera")]
    NoCamera,
}

/// Grows a [`Scene`], one checked object at a time, in document order.
#[derive(Debug, Default)]
pub struct SceneBuilder {
    camera: Option<Camera>,
    background: Rgb,
    lights: Vec<DVec3>,
    planes: Vec<Plane>,
    spheres: Vec<Sphere>,
    orientations: Vec<(u32, Orientation)>,
    triangles: Vec<Triangle>,
    surfaces: Vec<Surface>,
    surface_ids: HashMap<[u64; 5], SurfaceId>,
    pictures: Vec<Texture>,
    next_order: Order,
}

/// `objects` with room for `more`.
fn extended<T>(objects: Vec<T>, more: usize) -> Vec<T> {
    let mut extended = roomy(objects.len() + more);
    extended.extend(objects);
    extended
}

impl SceneBuilder {
    /// An empty scene: no camera, black background.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Room for `triangles` and `spheres` more, taken at once.
    pub fn reserve(&mut self, triangles: usize, spheres: usize) {
        self.triangles = extended(std::mem::take(&mut self.triangles), triangles);
        self.spheres = extended(std::mem::take(&mut self.spheres), spheres);
    }

    /// Sets the eye.
    ///
    /// # Errors
    /// `look_at` = `location`, or `sky` zero or parallel to the view, decided exactly.
    pub fn camera(&mut self, location: DVec3, sky: DVec3, look_at: DVec3) -> Result<(), Invalid> {
        rules::view(location, sky, look_at)?;
        self.camera = Some(Camera { location, sky, look_at });
        Ok(())
    }

    /// Sets the colour where nothing is hit.
    ///
    /// # Errors
    /// A component outside [0, 1].
    pub fn background(&mut self, color: Rgb) -> Result<(), Invalid> {
        for c in color {
            rules::share(c)?;
        }
        self.background = color;
        Ok(())
    }

    /// Adds a point light.
    ///
    /// # Errors
    /// A position that is not finite.
    pub fn light(&mut self, position: DVec3) -> Result<(), Invalid> {
        self.lights.push(finite(position)?);
        Ok(())
    }

    /// Adds a picture that surfaces may use. The caller adds equal files once.
    ///
    /// # Errors
    /// More pictures than ids.
    pub fn texture(&mut self, picture: Texture) -> Result<TextureId, Invalid> {
        let id = u32::try_from(self.pictures.len()).map_err(|_| Invalid::TooMany)?;
        self.pictures.push(picture);
        Ok(TextureId(id))
    }

    /// The id of `surface`, the same for equal surfaces.
    ///
    /// # Errors
    /// A number outside [0, 1], an unknown picture, or more surfaces than ids.
    pub fn surface(&mut self, surface: Surface) -> Result<SurfaceId, Invalid> {
        let Surface { diffuse, reflect, pigment } = surface;
        let (diffuse, reflect) = (rules::share(diffuse)?, rules::share(reflect)?);
        let (pigment, key) = match pigment {
            Pigment::Color([r, g, b]) => {
                let c = [rules::share(r)?, rules::share(g)?, rules::share(b)?];
                (Pigment::Color(c), c.map(f64::to_bits))
            }
            Pigment::Texture(TextureId(id)) => {
                if id as usize >= self.pictures.len() {
                    return Err(Invalid::Unknown(id));
                }
                (pigment, [u64::MAX, id.into(), 0])
            }
        };
        let key = [diffuse.to_bits(), reflect.to_bits(), key[0], key[1], key[2]];
        if let Some(&id) = self.surface_ids.get(&key) {
            return Ok(id);
        }
        let id = u32::try_from(self.surfaces.len())
            .ok()
            .filter(|&id| id < Triangle::SIDES)
            .map(SurfaceId)
            .ok_or(Invalid::TooMany)?;
        self.surfaces.push(Surface { diffuse, reflect, pigment });
        self.surface_ids.insert(key, id);
        Ok(id)
    }

    fn known(&self, surface: SurfaceId) -> Result<SurfaceId, Invalid> {
        if (surface.0 as usize) < self.surfaces.len() { Ok(surface) } else { Err(Invalid::Unknown(surface.0)) }
    }

    fn order(&mut self) -> Result<Order, Invalid> {
        let order = self.next_order;
        self.next_order = order.checked_add(1).filter(|&n| n <= MOST_OBJECTS).ok_or(Invalid::TooMany)?;
        Ok(order)
    }

    /// Adds an infinite plane.
    ///
    /// # Errors
    /// A zero normal or a number that is not finite.
    pub fn plane(&mut self, normal: DVec3, position: PlanePosition, surface: SurfaceId) -> Result<(), Invalid> {
        rules::direction(normal, Invalid::ZeroNormal)?;
        match position {
            PlanePosition::Point(p) => drop(finite(p)?),
            PlanePosition::Distance(d) if !d.is_finite() => return Err(Invalid::NotFinite),
            PlanePosition::Distance(_) => {}
        }
        let (surface, order) = (self.known(surface)?, self.order()?);
        self.planes.push(Plane { normal, position, surface, order });
        Ok(())
    }

    /// Adds a sphere. `orientation` is kept only where the surface's pigment is a picture;
    /// `None` there means pole +y, equator +x.
    ///
    /// # Errors
    /// A radius not above 0, a bad orientation, or a number that is not finite.
    pub fn sphere(
        &mut self,
        center: DVec3,
        radius: f64,
        orientation: Option<Orientation>,
        surface: SurfaceId,
    ) -> Result<(), Invalid> {
        finite(center)?;
        rules::radius(radius)?;
        let surface = self.known(surface)?;
        if let Some(o) = &orientation {
            rules::orientation(Some(o.pole), Some(o.equator))?;
        }
        if matches!(self.surfaces[surface.0 as usize].pigment, Pigment::Texture(_)) {
            let index = u32::try_from(self.spheres.len()).map_err(|_| Invalid::TooMany)?;
            let o = orientation.unwrap_or(Orientation { pole: DVec3::Y, equator: DVec3::X });
            self.orientations.push((index, o));
        }
        let order = self.order()?;
        self.spheres.push(Sphere { center, radius, surface, order });
        Ok(())
    }

    /// Adds a triangle by its corners c0, c1, c2.
    ///
    /// # Errors
    /// A number that is not finite.
    pub fn triangle(&mut self, corners: [DVec3; 3], surface: SurfaceId) -> Result<(), Invalid> {
        self.push_triangle(corners, 0, surface)
    }

    /// Adds a triangle by its corner c0 and its sides v1 and v2.
    ///
    /// # Errors
    /// A number that is not finite.
    pub fn triangle_by_sides(&mut self, c0: DVec3, sides: [DVec3; 2], surface: SurfaceId) -> Result<(), Invalid> {
        self.push_triangle([c0, sides[0], sides[1]], Triangle::SIDES, surface)
    }

    fn push_triangle(&mut self, written: [DVec3; 3], form: u32, surface: SurfaceId) -> Result<(), Invalid> {
        for v in written {
            finite(v)?;
        }
        let (surface, order) = (self.known(surface)?, self.order()?);
        self.triangles.push(Triangle { written, surface_and_form: surface.0 | form, order });
        Ok(())
    }

    /// The finished scene.
    ///
    /// # Errors
    /// When no camera was set.
    pub fn finish(self) -> Result<Scene, Invalid> {
        Ok(Scene {
            camera: self.camera.ok_or(Invalid::NoCamera)?,
            background: self.background,
            lights: self.lights,
            planes: self.planes,
            spheres: self.spheres,
            orientations: self.orientations,
            triangles: self.triangles,
            surfaces: self.surfaces,
            pictures: self.pictures,
        })
    }
}
