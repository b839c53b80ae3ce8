//! A scene as its document says it, before anything is resolved.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use glam::DVec3;
use tessera_core::scene::{
    Invalid, Orientation, Pigment, PlanePosition, Rgb, Scene, SceneBuilder, Surface, SurfaceId, Texture,
};

/// What a surface looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// Share scattered.
    pub diffuse: f64,
    /// Share mirrored.
    pub reflect: f64,
    /// Colour of what is scattered.
    pub paint: Paint,
}

/// One colour, or a picture of the document.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// The same everywhere.
    Color(Rgb),
    /// Index into [`Document::textures`].
    Texture(usize),
}

impl Look {
    /// A colour that scatters all it does not absorb.
    #[must_use]
    pub const fn matte(r: f64, g: f64, b: f64) -> Self {
        Self::new(r, g, b, 1.0, 0.0)
    }

    /// Matte white, as where a document says nothing.
    #[must_use]
    pub const fn default_matte() -> Self {
        Self::matte(1.0, 1.0, 1.0)
    }

    /// A colour with both shares.
    #[must_use]
    pub const fn new(r: f64, g: f64, b: f64, diffuse: f64, reflect: f64) -> Self {
        Self { diffuse, reflect, paint: Paint::Color([r, g, b]) }
    }

    /// A picture with both shares.
    #[must_use]
    pub const fn picture(index: usize, diffuse: f64, reflect: f64) -> Self {
        Self { diffuse, reflect, paint: Paint::Texture(index) }
    }

    /// A mirror of the given strength that scatters nothing.
    #[must_use]
    pub const fn mirror(reflect: f64) -> Self {
        Self::new(1.0, 1.0, 1.0, 0.0, reflect)
    }
}

/// Where a plane lies.
pub type Placement = PlanePosition;

/// One child of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Item {
    /// A point light.
    Light(DVec3),
    /// An infinite plane: normal, place, look.
    Plane(DVec3, Placement, Look),
    /// Centre, radius, pole and equator, look.
    Sphere(DVec3, f64, Option<Orientation>, Look),
    /// Three corners.
    Triangle([DVec3; 3], Look),
    /// A corner and two sides.
    TriangleSides([DVec3; 3], Look),
}

/// A scene document.
#[derive(Clone, Debug, PartialEq)]
pub struct Document {
    /// Location, sky, look_at.
    pub camera: [DVec3; 3],
    /// Colour where nothing is hit.
    pub background: Rgb,
    /// The world's children, in order.
    pub items: Vec<Item>,
    /// File name and content of each picture.
    pub textures: Vec<(String, Texture)>,
}

impl Document {
    /// An empty world seen from `location` towards `look_at`, +y up.
    #[must_use]
    pub fn new(location: DVec3, look_at: DVec3) -> Self {
        Self { camera: [location, DVec3::Y, look_at], background: [0.0; 3], items: Vec::new(), textures: Vec::new() }
    }

    /// The same with another background.
    #[must_use]
    pub fn with_background(mut self, r: f64, g: f64, b: f64) -> Self {
        self.background = [r, g, b];
        self
    }

    /// The same with `item` added.
    #[must_use]
    pub fn with(mut self, item: Item) -> Self {
        self.items.push(item);
        self
    }

    /// The same with a light added.
    #[must_use]
    pub fn light(self, x: f64, y: f64, z: f64) -> Self {
        self.with(Item::Light(DVec3::new(x, y, z)))
    }

    /// The same with a sphere added.
    #[must_use]
    pub fn sphere(self, center: DVec3, radius: f64, look: Look) -> Self {
        self.with(Item::Sphere(center, radius, None, look))
    }

    /// The same with a plane by distance added.
    #[must_use]
    pub fn plane(self, normal: DVec3, distance: f64, look: Look) -> Self {
        self.with(Item::Plane(normal, PlanePosition::Distance(distance), look))
    }

    /// The same with a plane by point added.
    #[must_use]
    pub fn plane_at(self, normal: DVec3, point: DVec3, look: Look) -> Self {
        self.with(Item::Plane(normal, PlanePosition::Point(point), look))
    }

    /// The same with a triangle by corners added.
    #[must_use]
    pub fn triangle(self, corners: [DVec3; 3], look: Look) -> Self {
        self.with(Item::Triangle(corners, look))
    }

    /// The same with every coordinate and length mapped by the factor.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let mut out = self.clone();
        let f = factor;
        // The sky is a direction, but the whole document is scaled, as a user would.
        out.camera = out.camera.map(|v| v * f);
        for item in &mut out.items {
            match item {
                Item::Light(p) => *p *= f,
                Item::Plane(_, PlanePosition::Point(p), _) => *p *= f,
                Item::Plane(_, PlanePosition::Distance(d), _) => *d *= f,
                Item::Sphere(c, r, _, _) => {
                    *c *= f;
                    *r *= f;
                }
                Item::Triangle(c, _) | Item::TriangleSides(c, _) => *c = c.map(|v| v * f),
            }
        }
        out
    }

    /// The same moved by `offset`, each coordinate rounded once. A plane by distance goes
    /// through the moved foot of its perpendicular, so it should have an axis for its normal.
    #[must_use]
    pub fn moved(&self, offset: DVec3) -> Self {
        let mut out = self.clone();
        out.camera[0] += offset;
        out.camera[2] += offset;
        for item in &mut out.items {
            match item {
                Item::Light(p) | Item::Sphere(p, ..) => *p += offset,
                Item::Plane(n, place, _) => {
                    let p = match *place {
                        PlanePosition::Point(p) => p,
                        PlanePosition::Distance(d) => n.normalize() * d,
                    };
                    *place = PlanePosition::Point(p + offset);
                }
                Item::Triangle(c, _) => *c = c.map(|v| v + offset),
                Item::TriangleSides(c, _) => c[0] += offset,
            }
        }
        out
    }

    /// Resolves the document without going through text.
    ///
    /// # Errors
    /// Whatever the scene's semantic checks refuse.
    pub fn scene(&self) -> Result<Scene, Invalid> {
        let mut b = SceneBuilder::new();
        let [location, sky, look_at] = self.camera;
        b.camera(location, sky, look_at)?;
        b.background(self.background)?;
        let mut textures = Vec::new();
        for (_, p) in &self.textures {
            textures.push(b.texture(p.clone())?);
        }
        let surface = |b: &mut SceneBuilder, look: &Look| -> Result<SurfaceId, Invalid> {
            let pigment = match look.paint {
                Paint::Color(c) => Pigment::Color(c),
                Paint::Texture(i) => Pigment::Texture(textures[i]),
            };
            b.surface(Surface { diffuse: look.diffuse, reflect: look.reflect, pigment })
        };
        for item in &self.items {
            match item {
                Item::Light(p) => b.light(*p)?,
                Item::Plane(n, place, look) => {
                    let s = surface(&mut b, look)?;
                    b.plane(*n, *place, s)?;
                }
                Item::Sphere(c, r, o, look) => {
                    let s = surface(&mut b, look)?;
                    b.sphere(*c, *r, *o, s)?;
                }
                Item::Triangle(c, look) => {
                    let s = surface(&mut b, look)?;
                    b.triangle(*c, s)?;
                }
                Item::TriangleSides([c, v1, v2], look) => {
                    let s = surface(&mut b, look)?;
                    b.triangle_by_sides(*c, [*v1, *v2], s)?;
                }
            }
        }
        b.finish()
    }

    /// The document's text: every number in the fewest digits that read back as itself.
    #[must_use]
    pub fn xml(&self) -> String {
        let mut w = String::from(
            "<?xml version=\"1.0\" encoding=\"iso-8859-1\"?>\n<!DOCTYPE scene SYSTEM \"pm2gl.dtd\">\n<scene>\n",
        );
        let [location, sky, look_at] = self.camera.map(vector);
        let [r, g, b] = self.background.map(number);
        // Writing to a String cannot fail.
        let _ =
            writeln!(w, "<camera><location>{location}</location><sky>{sky}</sky><look_at>{look_at}</look_at></camera>");
        let _ = writeln!(w, "<background><color red=\"{r}\" green=\"{g}\" blue=\"{b}\"/></background>\n<world>");
        for item in &self.items {
            let _ = match item {
                Item::Light(p) => writeln!(w, "<light><position>{}</position></light>", vector(*p)),
                Item::Plane(n, PlanePosition::Distance(d), look) => writeln!(
                    w,
                    "<plane distance=\"{}\"><normal>{}</normal>{}</plane>",
                    number(*d),
                    vector(*n),
                    self.surface(look)
                ),
                Item::Plane(n, PlanePosition::Point(p), look) => writeln!(
                    w,
                    "<plane><normal>{}</normal><point>{}</point>{}</plane>",
                    vector(*n),
                    vector(*p),
                    self.surface(look)
                ),
                Item::Sphere(c, r, o, look) => {
                    let o = o.map_or(String::new(), |o| {
                        format!("<pole>{}</pole><equator>{}</equator>", vector(o.pole), vector(o.equator))
                    });
                    writeln!(
                        w,
                        "<sphere radius=\"{}\"><location>{}</location>{o}{}</sphere>",
                        number(*r),
                        vector(*c),
                        self.surface(look)
                    )
                }
                Item::Triangle(c, look) => {
                    let [a, b, c] = c.map(vector);
                    writeln!(w, "<triangle><c0>{a}</c0><c1>{b}</c1><c2>{c}</c2>{}</triangle>", self.surface(look))
                }
                Item::TriangleSides(c, look) => {
                    let [a, b, c] = c.map(vector);
                    writeln!(w, "<triangle><c0>{a}</c0><v1>{b}</v1><v2>{c}</v2>{}</triangle>", self.surface(look))
                }
            };
        }
        w.push_str("</world>\n</scene>\n");
        w
    }

    fn surface(&self, look: &Look) -> String {
        let pigment = match look.paint {
            Paint::Color(c) => {
                let [r, g, b] = c.map(number);
                format!("<color red=\"{r}\" green=\"{g}\" blue=\"{b}\"/>")
            }
            Paint::Texture(i) => format!("<image><ppm file=\"{}\"/></image>", self.textures[i].0),
        };
        let (d, r) = (number(look.diffuse), number(look.reflect));
        format!("<surface><finish diffuse=\"{d}\" reflect=\"{r}\"/><pigment>{pigment}</pigment></surface>")
    }

    /// Writes `name`.xml and its pictures into `folder`.
    ///
    /// # Errors
    /// What writing files can meet.
    pub fn write(&self, folder: &Path, name: &str) -> io::Result<()> {
        for (file, picture) in &self.textures {
            std::fs::write(folder.join(file), ppm(picture))?;
        }
        std::fs::write(folder.join(format!("{name}.xml")), self.xml())
    }
}

/// A picture as a binary portable pixmap.
#[must_use]
pub(super) fn ppm(picture: &Texture) -> Vec<u8> {
    let mut out = format!("P6\n{} {}\n{}\n", picture.width(), picture.height(), picture.maxval()).into_bytes();
    match (picture.bytes(), picture.words()) {
        (Some(bytes), _) => out.extend_from_slice(bytes),
        (None, words) => out.extend(words.unwrap_or_default().iter().flat_map(|w| w.to_be_bytes())),
    }
    out
}

fn number(x: f64) -> String {
    if x == x.trunc() && x.abs() < 1e15 && !(x == 0.0 && x.is_sign_negative()) {
        format!("{x}")
    } else {
        format!("{x:?}")
    }
}

fn vector(v: DVec3) -> String {
    format!("<vector x=\"{}\" y=\"{}\" z=\"{}\"/>", number(v.x), number(v.y), number(v.z))
}
