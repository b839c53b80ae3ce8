//! The tracer under test, and what it is held to.

use std::sync::Arc;

use glam::DVec3;
use tessera_core::film::Region;
use tessera_core::scene::Scene;
use tessera_core::settings::{Sampling, Settings, Transfer, View};
use tessera_core::simd::Level;
use tessera_core::trace::{PreparedScene, RayCounts, RayHit, Tracer};

use crate::compare::{Image, assert_same_picture, difference};
use crate::exact;
use crate::generate::Document;
use crate::oracle::Oracle;

/// A document as the tracer holds it.
#[derive(Debug)]
pub struct Subject {
    prepared: Arc<PreparedScene>,
}

impl Subject {
    /// Prepares the document.
    ///
    /// # Panics
    /// When the document is not valid.
    #[must_use]
    #[track_caller]
    pub fn new(document: &Document) -> Self {
        let scene = document.scene().unwrap_or_else(|e| panic!("the document is not valid: {e}"));
        Self { prepared: Arc::new(PreparedScene::build(Arc::new(scene))) }
    }

    /// The resolved scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        self.prepared.scene()
    }

    /// What the ray meets first.
    #[must_use]
    pub fn hit(&self, origin: DVec3, direction: DVec3) -> Option<RayHit> {
        self.prepared.closest_hit(origin, direction)
    }

    /// Whether something meets the open segment.
    #[must_use]
    pub fn occluded(&self, from: DVec3, to: DVec3) -> bool {
        self.prepared.is_occluded(from, to)
    }

    /// Judges the tracer's hit of one ray; the scene has one object.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn judge(&self, origin: DVec3, direction: DVec3) -> Result<(), String> {
        exact::judge(self.scene(), origin, direction, self.hit(origin, direction).map(|h| h.t))
    }

    /// Demands that the hit of one ray is right; the scene has one object.
    ///
    /// # Panics
    /// When it is not.
    #[track_caller]
    pub fn assert_exact(&self, origin: DVec3, direction: DVec3) {
        if let Err(e) = self.judge(origin, direction) {
            panic!("{e}");
        }
    }

    /// Demands that the ray's nearest object and distance are the oracle's.
    ///
    /// # Panics
    /// When they are not.
    #[track_caller]
    pub fn assert_as_oracle(&self, oracle: &Oracle<'_>, origin: DVec3, direction: DVec3) {
        let (actual, expected) = (self.hit(origin, direction), oracle.closest_hit(origin, direction));
        let right = match (&actual, &expected) {
            (None, None) => true,
            (Some(a), Some((order, t))) => {
                let t = t.to_f64();
                a.order == *order && (t.next_down()..=t.next_up()).contains(&a.t)
            }
            _ => false,
        };
        let expected = expected.map(|(order, t)| (order, t.to_f64()));
        assert!(right, "ray {origin:?} + t {direction:?}: {actual:?}, not {expected:?}");
    }

    /// The picture's pixels as the tracer gives them, and the rays it took; by the instructions of
    /// every level of this machine, and by f64 without packets: each has to give the same bits.
    ///
    /// # Panics
    /// When the settings are out of range, or a level gives other bits.
    #[must_use]
    pub fn trace(&self, settings: &Settings) -> (Vec<[f32; 3]>, RayCounts) {
        let whole = Region::new(0, 0, settings.view.width(), settings.view.height());
        let whole = whole.unwrap_or_else(|| unreachable!("a view has pixels"));
        let tracer = Tracer::new(Arc::clone(&self.prepared), *settings).unwrap_or_else(|e| panic!("{e}"));
        let by = |level: Level| {
            let (tile, counts) = tracer.clone().with_level(level).render(whole);
            (tile.pixels, counts)
        };
        let (pixels, counts) = by(Level::best());
        let bits = |pixels: &[[f32; 3]]| -> Vec<[u32; 3]> { pixels.iter().map(|p| p.map(f32::to_bits)).collect() };
        for level in Level::all().into_iter().filter(|level| *level != Level::best()) {
            assert_eq!(bits(&by(level).0), bits(&pixels), "{level:?} gives other bits than {:?}", Level::best());
        }
        let plain = tracer.without_filter().render(whole).0.pixels;
        assert_eq!(bits(&plain), bits(&pixels), "f64 gives other bits than packets");
        (pixels, counts)
    }

    /// The picture's pixels, as [`Self::trace`] gives them.
    #[must_use]
    pub fn pixels(&self, settings: &Settings) -> Vec<[f32; 3]> {
        self.trace(settings).0
    }

    /// The whole picture.
    #[must_use]
    pub fn render(&self, settings: &Settings) -> Image {
        Image {
            width: settings.view.width() as usize,
            height: settings.view.height() as usize,
            pixels: self.pixels(settings).iter().map(|p| p.map(f64::from)).collect(),
        }
    }
}

/// One linear sample a pixel, six rays a path.
///
/// # Panics
/// When a size is out of range.
#[must_use]
pub fn settings(width: u32, height: u32) -> Settings {
    Settings {
        view: View::new(width, height, 1.0, 1.0).unwrap_or_else(|e| panic!("{e}")),
        max_depth: 6,
        sampling: Sampling::Uniform { grid: 1 },
        transfer: Transfer::Linear,
    }
}

/// The document's pixels at 64x48.
#[must_use]
#[track_caller]
pub fn small(document: &Document) -> Vec<[f32; 3]> {
    Subject::new(document).pixels(&settings(64, 48))
}

/// Demands that the tracer's 64x48 picture is the oracle's, and returns that.
#[track_caller]
pub fn assert_right(name: &str, document: &Document) -> Image {
    assert_right_under(name, document, &settings(64, 48))
}

/// Demands that the tracer's picture under the settings is the oracle's, and returns that.
///
/// # Panics
/// When a pixel is wrong.
#[track_caller]
pub fn assert_right_under(name: &str, document: &Document, settings: &Settings) -> Image {
    let subject = Subject::new(document);
    let expected = truth(subject.scene(), settings);
    let actual = subject.render(settings);
    let d = difference(&expected, &actual);
    println!("{name}: largest difference {:.1e}, {} colours", d.largest, colors(&expected));
    assert_same_picture(name, &expected, &actual);
    expected
}

/// The oracle's picture, at a precision that decides all that can be decided.
///
/// # Panics
/// When 16,384 bits do not suffice.
#[must_use]
pub fn truth(scene: &Scene, settings: &Settings) -> Image {
    // Squares of the largest length beside squares of the smallest, and 512 bits to spare.
    let mut bits = 512 + 2 * span(scene).next_multiple_of(64);
    loop {
        let picture = Oracle::new(scene, bits).render(settings);
        if picture.decisions.margin > 100.0 {
            return picture.image;
        }
        bits *= 2;
        assert!(bits <= 16384, "the scene asks for more than 16,384 bits: {:?}", picture.decisions);
    }
}

/// Powers of two between the scene's greatest and least lengths, beyond what f64 spans anyway.
fn span(scene: &Scene) -> usize {
    let camera = scene.camera();
    let mut all = vec![camera.location(), camera.look_at()];
    all.extend(scene.lights());
    all.extend(scene.spheres().iter().flat_map(|s| [s.center, DVec3::splat(s.radius)]));
    all.extend(scene.triangles().iter().flat_map(|t| t.written));
    if !scene.textures().is_empty() {
        // On a plane they repeat in unit squares, however large the world is.
        all.push(DVec3::ONE);
    }
    for p in scene.planes() {
        match p.position {
            tessera_core::scene::PlanePosition::Point(q) => all.push(q),
            tessera_core::scene::PlanePosition::Distance(d) => all.push(DVec3::splat(d)),
        }
    }
    let exponents = all.iter().flat_map(|v| v.to_array()).filter(|x| *x != 0.0).map(libm::ilogb);
    let (lo, hi) = exponents.fold((i32::MAX, i32::MIN), |(lo, hi), e| (lo.min(e), hi.max(e)));
    usize::try_from(i64::from(hi) - i64::from(lo) - 60).unwrap_or(0)
}

/// How many different colours a picture has.
#[must_use]
pub fn colors(image: &Image) -> usize {
    let mut all: Vec<[u64; 3]> = image.pixels.iter().map(|p| p.map(f64::to_bits)).collect();
    all.sort_unstable();
    all.dedup();
    all.len()
}
