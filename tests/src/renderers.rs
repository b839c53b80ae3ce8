//! What renders tiles where the tracer would be too quick, too slow or too sound.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex};

use coordinator::{Pixels, Rendered};
use tessera_core::film::{ErrorEstimate, Region, Tile};
use tessera_core::settings::{Pass, Settings};
use tessera_core::trace::{PrepareError, PreparedScene, RayCounts};
use worker::{Exact, RendererFactory, TileTracer};

/// What [`Painted`] gives pixel (x, y).
#[must_use]
pub fn paint(x: u32, y: u32) -> [f32; 3] {
    [x as f32 / 65536.0, y as f32 / 65536.0, 1.0]
}

/// Renders no scene but [`paint`], at once: a picture in which every pixel shows whether it is
/// in its place and done.
#[derive(Clone, Copy, Debug)]
pub struct Painted;

impl RendererFactory for Painted {
    fn open(&self, _: Arc<PreparedScene>, _: Settings) -> Result<Arc<dyn TileTracer>, PrepareError> {
        Ok(Arc::new(Self))
    }
}

impl TileTracer for Painted {
    fn render(&self, region: Region) -> (Tile, RayCounts) {
        let row = |y| (region.x0..region.x1).map(move |x| paint(x, y));
        let pixels = (region.y0..region.y1).flat_map(row).collect();
        (Tile { region, pixels, error: ErrorEstimate::default() }, RayCounts::default())
    }
}

/// Holds a whole picture against what [`Painted`] paints.
///
/// # Panics
/// When a pixel is missing or another's, or they are not floats in memory.
pub fn assert_painted(rendered: &Rendered) {
    assert!(rendered.is_complete());
    let Some(Pixels::F32(pixels)) = rendered.image.pixels() else { panic!("not floats") };
    let Region { x0, y0, .. } = rendered.region;
    let width = rendered.region.width();
    for (i, pixel) in pixels.iter().enumerate() {
        let (x, y) = (x0 + i as u32 % width, y0 + i as u32 / width);
        assert_eq!(*pixel, paint(x, y), "pixel {x},{y}");
    }
}

/// Fails at every tile that holds the pixel.
#[derive(Clone, Copy, Debug)]
pub struct Poisoned {
    /// The pixel.
    pub pixel: (u32, u32),
    /// How it fails.
    pub failure: Failure,
}

/// How a tracer fails.
#[derive(Clone, Copy, Debug)]
pub enum Failure {
    /// By a panic.
    Panic,
    /// By giving what is no number.
    NotANumber,
}

impl RendererFactory for Poisoned {
    fn open(&self, _: Arc<PreparedScene>, _: Settings) -> Result<Arc<dyn TileTracer>, PrepareError> {
        Ok(Arc::new(*self))
    }
}

impl TileTracer for Poisoned {
    fn render(&self, region: Region) -> (Tile, RayCounts) {
        let (mut tile, rays) = Painted.render(region);
        let (x, y) = self.pixel;
        if region.contains(&Region { x0: x, y0: y, x1: x + 1, y1: y + 1 }) {
            match self.failure {
                Failure::Panic => panic!("poison at {x},{y}"),
                Failure::NotANumber => tile.pixels[0][1] = f32::NAN,
            }
        }
        (tile, rays)
    }
}

/// Another factory behind a gate: a number of tiles pass, the others wait until it is opened.
#[derive(Clone, Debug)]
pub struct Gate {
    behind: Arc<dyn RendererFactory>,
    state: Arc<GateState>,
}

#[derive(Debug)]
struct GateState {
    passes: AtomicI64,
    open: Mutex<bool>,
    opened: Condvar,
}

impl Gate {
    /// Lets `passes` tiles of `behind` through.
    #[must_use]
    pub fn before(behind: impl RendererFactory + 'static, passes: i64) -> Self {
        let state = GateState { passes: passes.into(), open: Mutex::new(false), opened: Condvar::new() };
        Self { behind: Arc::new(behind), state: Arc::new(state) }
    }

    /// Lets `passes` tiles of the tracer through.
    #[must_use]
    pub fn after(passes: i64) -> Self {
        Self::before(Exact, passes)
    }

    /// Lets everything through from now on.
    ///
    /// # Panics
    /// When a tile panicked at the gate.
    pub fn open(&self) {
        *self.state.open.lock().expect("nobody panics here") = true;
        self.state.opened.notify_all();
    }
}

struct Gated(Arc<dyn TileTracer>, Arc<GateState>);

impl RendererFactory for Gate {
    fn open(&self, scene: Arc<PreparedScene>, settings: Settings) -> Result<Arc<dyn TileTracer>, PrepareError> {
        Ok(Arc::new(Gated(self.behind.open(scene, settings)?, self.state.clone())))
    }
}

impl Gated {
    fn wait(&self) {
        if self.1.passes.fetch_sub(1, Ordering::SeqCst) <= 0 {
            let open = self.1.open.lock().expect("nobody panics here");
            drop(self.1.opened.wait_while(open, |open| !*open).expect("nobody panics here"));
        }
    }
}

impl TileTracer for Gated {
    fn render(&self, region: Region) -> (Tile, RayCounts) {
        self.wait();
        self.0.render(region)
    }

    fn render_pass(&self, region: Region, pass: Pass) -> (Tile, RayCounts) {
        self.wait();
        self.0.render_pass(region, pass)
    }
}

/// The tracer, but for one bit in every so many tiles: a machine with bad memory, or its owner.
#[derive(Clone, Debug)]
pub struct Liar {
    every: u64,
    rendered: Arc<AtomicU64>,
    about: Lie,
}

/// What is lied about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lie {
    /// The last bit of a pixel's component.
    Pixel,
    /// How far off the pixels may be.
    Estimate,
}

impl Liar {
    /// Lies in one tile of `every`, the first one being true.
    #[must_use]
    pub fn once_in(every: u64, about: Lie) -> Self {
        Self { every, rendered: Arc::default(), about }
    }
}

struct Lying(Arc<dyn TileTracer>, Liar);

impl RendererFactory for Liar {
    fn open(&self, scene: Arc<PreparedScene>, settings: Settings) -> Result<Arc<dyn TileTracer>, PrepareError> {
        Ok(Arc::new(Lying(Exact.open(scene, settings)?, self.clone())))
    }
}

impl Lying {
    fn lie(&self, (mut tile, rays): (Tile, RayCounts)) -> (Tile, RayCounts) {
        if self.1.rendered.fetch_add(1, Ordering::SeqCst) % self.1.every == self.1.every - 1 {
            let middle = tile.pixels.len() / 2;
            match self.1.about {
                Lie::Pixel => {
                    let component = &mut tile.pixels[middle][1];
                    *component = f32::from_bits(component.to_bits() ^ 1);
                }
                Lie::Estimate => tile.error.squares.0 /= 2,
            }
        }
        (tile, rays)
    }
}

impl TileTracer for Lying {
    fn render(&self, region: Region) -> (Tile, RayCounts) {
        self.lie(self.0.render(region))
    }

    fn render_pass(&self, region: Region, pass: Pass) -> (Tile, RayCounts) {
        self.lie(self.0.render_pass(region, pass))
    }
}
