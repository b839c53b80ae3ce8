//! What is in a scene, and what tracing it takes.

use std::fmt::Write;

use serde::Serialize;
use tessera_core::scene::{Pigment, Scene, SurfaceId};
use tessera_core::simd::Level;

/// A scene in numbers.
#[derive(Debug, Serialize)]
pub(crate) struct Description {
    /// Its file.
    pub(crate) file: String,
    objects: u64,
    spheres: u64,
    triangles: u64,
    planes: u64,
    lights: u64,
    surfaces: u64,
    pictures: Vec<PictureSize>,
    /// Objects that mirror something.
    mirrors: u64,
    /// Objects whose colour is a picture.
    pictured: u64,
    /// Corners of the box around all spheres and triangles.
    extent: Option<Extent>,
    camera: CameraDescription,
    background: [f64; 3],
    needs: Vec<Need>,
}

#[derive(Debug, Serialize)]
struct PictureSize {
    width: u32,
    height: u32,
    maxval: u16,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Extent {
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Debug, Serialize)]
struct CameraDescription {
    location: [f64; 3],
    look_at: [f64; 3],
    sky: [f64; 3],
}

/// Something that tracing may or may not have to do.
#[derive(Debug, Serialize)]
struct Need {
    what: &'static str,
    needed: bool,
    why: String,
}

impl Description {
    /// Describes `scene`, read from `file`.
    pub(crate) fn new(file: &str, scene: &Scene) -> Self {
        let ids = || {
            let planes = scene.planes().iter().map(|o| o.surface);
            let spheres = scene.spheres().iter().map(|o| o.surface);
            planes.chain(spheres).chain(scene.triangles().iter().map(|o| o.surface()))
        };
        let is_mirror: Vec<bool> = scene.surfaces().iter().map(|s| s.reflect > 0.0).collect();
        let is_pictured: Vec<bool> =
            scene.surfaces().iter().map(|s| matches!(s.pigment, Pigment::Texture(_))).collect();
        let is_matte: Vec<bool> = scene.surfaces().iter().map(|s| s.diffuse > 0.0).collect();
        let count = |of: &[bool]| ids().filter(|&SurfaceId(i)| of[i as usize]).count() as u64;
        let (mirrors, pictured, matte) = (count(&is_mirror), count(&is_pictured), count(&is_matte));
        let lights = scene.lights().len() as u64;
        let needs = vec![
            Need {
                what: "reflected rays",
                needed: mirrors > 0,
                why: if mirrors > 0 { of(mirrors, "mirroring object") } else { "nothing mirrors".into() },
            },
            Need {
                what: "shadow rays",
                needed: lights > 0 && matte > 0,
                why: match (lights, matte) {
                    (0, _) => "there is no light".into(),
                    (_, 0) => "nothing scatters light".into(),
                    _ => format!("{}, {}", of(lights, "light"), of(matte, "scattering object")),
                },
            },
            Need {
                what: "picture coordinates",
                needed: pictured > 0,
                why: if pictured > 0 { of(pictured, "pictured object") } else { "nothing is pictured".into() },
            },
            Need {
                what: "a hierarchy of boxes",
                needed: scene.spheres().len() + scene.triangles().len() > 0,
                why: match (scene.spheres().len(), scene.triangles().len()) {
                    (0, 0) => "nothing is bounded".into(),
                    (_, 0) => "all its leaves are of spheres".into(),
                    (0, _) => "all its leaves are of triangles".into(),
                    _ => "each leaf is of spheres or of triangles".into(),
                },
            },
            Need {
                what: "wide instructions",
                needed: Level::best() != Level::Baseline,
                why: match Level::best() {
                    Level::Avx512 => "AVX-512 here, sixteen rays at a time".into(),
                    Level::Avx2 => "AVX2 here, sixteen rays at a time".into(),
                    Level::Baseline => "this machine offers none that are used; the bits are the same".into(),
                },
            },
        ];
        let camera = scene.camera();
        Self {
            file: file.to_owned(),
            objects: scene.object_count() as u64,
            spheres: scene.spheres().len() as u64,
            triangles: scene.triangles().len() as u64,
            planes: scene.planes().len() as u64,
            lights,
            surfaces: scene.surfaces().len() as u64,
            pictures: scene
                .textures()
                .iter()
                .map(|p| PictureSize { width: p.width(), height: p.height(), maxval: p.maxval() })
                .collect(),
            mirrors,
            pictured,
            extent: extent(scene),
            camera: CameraDescription {
                location: camera.location().to_array(),
                look_at: camera.look_at().to_array(),
                sky: camera.sky().to_array(),
            },
            background: scene.background(),
            needs,
        }
    }

    /// The description as people read it.
    pub(crate) fn to_text(&self) -> String {
        let mut text = String::new();
        let mut line = |name: &str, value: String| {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{name:<12}{value}");
        };
        line(
            "objects",
            format!(
                "{}: {}, {}, {}",
                grouped(self.objects),
                of(self.spheres, "sphere"),
                of(self.triangles, "triangle"),
                of(self.planes, "plane")
            ),
        );
        line("lights", grouped(self.lights));
        line(
            "surfaces",
            format!(
                "{} distinct; {}, {}",
                grouped(self.surfaces),
                of(self.mirrors, "mirroring object"),
                of(self.pictured, "pictured object")
            ),
        );
        for p in &self.pictures {
            line("picture", format!("{}x{} pixels, largest value {}", p.width, p.height, p.maxval));
        }
        match &self.extent {
            Some(Extent { min, max }) => {
                let size = [0, 1, 2].map(|i| max[i] - min[i]);
                line("extent", format!("{} to {}, size {}", vector(*min), vector(*max), vector(size)));
            }
            None => line("extent", "no bounded object".into()),
        }
        let CameraDescription { location, look_at, sky } = self.camera;
        line("camera", format!("at {}, looks at {}, sky {}", vector(location), vector(look_at), vector(sky)));
        line("background", vector(self.background));
        for n in &self.needs {
            line(if n.needed { "needs" } else { "needs no" }, format!("{}: {}", n.what, n.why));
        }
        text
    }
}

/// The box around all bounded objects, to the nearest f64.
fn extent(scene: &Scene) -> Option<Extent> {
    let mut extent: Option<Extent> = None;
    let mut add = |min: [f64; 3], max: [f64; 3]| {
        let e = extent.get_or_insert(Extent { min, max });
        for i in 0..3 {
            e.min[i] = e.min[i].min(min[i]);
            e.max[i] = e.max[i].max(max[i]);
        }
    };
    for s in scene.spheres() {
        add((s.center - s.radius).to_array(), (s.center + s.radius).to_array());
    }
    for t in scene.triangles() {
        let [a, b, c] = t.corners();
        add(a.min(b).min(c).to_array(), a.max(b).max(c).to_array());
    }
    extent
}

fn vector(v: [f64; 3]) -> String {
    let [x, y, z] = v.map(number);
    format!("({x}, {y}, {z})")
}

/// Six significant digits, as short as may be.
pub(crate) fn number(x: f64) -> String {
    let rounded: f64 = format!("{x:.5e}").parse().unwrap_or(x);
    if rounded != 0.0 && !(1e-4..1e7).contains(&rounded.abs()) { format!("{rounded:e}") } else { format!("{rounded}") }
}

/// 1234567 as 1,234,567.
fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(d);
    }
    text
}

/// "1 sphere", "2 spheres".
pub(crate) fn of(n: u64, what: &str) -> String {
    format!("{} {what}{}", grouped(n), if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!(grouped(871414), "871,414");
        assert_eq!((grouped(0), grouped(999), grouped(1000)), ("0".into(), "999".into(), "1,000".into()));
        assert_eq!(
            (number(0.1), number(1e300), number(-2.0), number(0.0)),
            ("0.1".into(), "1e300".into(), "-2".into(), "0".into())
        );
        assert_eq!(number(1.0 / 3.0), "0.333333");
    }
}
