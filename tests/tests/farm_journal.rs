//! Farms that go on from a journal, and that end whatever else goes on in their process.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on may stop")]

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use coordinator::journal::{Journal, Partial};
use coordinator::{RenderError, TileSize};
use tessera_core::film::{Region, Tile};
use tessera_core::settings::Settings;
use tessera_core::trace::{PrepareError, PreparedScene, RayCounts};
use tessera_tests::cluster::Cluster;
use tessera_tests::generate;
use tessera_tests::journal::Contents;
use tessera_tests::renderers::{Gate, Painted, assert_painted};
use worker::{RendererFactory, TileTracer};

const WHOLE: Region = Region { x0: 5, y0: 9, x1: 405, y1: 309 };

/// A part of a picture of which every pixel shows where it belongs.
fn painted() -> Cluster {
    let mut cluster = Cluster::of(generate::demo().scene().unwrap()).size(500, 400).factory(Painted);
    cluster.job.region = WHOLE;
    cluster
}

/// Counts the pixels that [`Painted`] is asked for.
#[derive(Clone, Debug, Default)]
struct Counted(Arc<AtomicU64>);

impl RendererFactory for Counted {
    fn open(&self, _: Arc<PreparedScene>, _: Settings) -> Result<Arc<dyn TileTracer>, PrepareError> {
        Ok(Arc::new(self.clone()))
    }
}

impl TileTracer for Counted {
    fn render(&self, region: Region) -> (Tile, RayCounts) {
        self.0.fetch_add(region.area(), Ordering::Relaxed);
        let (tile, _) = Painted.render(region);
        (tile, RayCounts { camera: region.area(), ..RayCounts::default() })
    }
}

fn journal(path: &Path) -> Arc<Journal> {
    Arc::new(Journal::open(path, false).unwrap().after(Duration::ZERO))
}

/// Renders `tiles` tiles and stops.
async fn begin(path: &Path, tile: TileSize, tiles: i64) {
    let mut cluster = painted().factory(Gate::before(Painted, tiles));
    cluster.job.tile = tile;
    let journal = journal(path);
    cluster.job.journal = Some(journal.clone());
    let mut running = cluster.start().await;
    running.until(|p| p.tiles_done >= p.earlier.tiles + tiles as u64).await;
    running.cancel.cancel();
    let ended = running.end().await.unwrap_err();
    assert!(matches!(ended.error, RenderError::Cancelled));
    assert_eq!(journal.kept(), Some(path));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_kept_is_not_rendered_again_whatever_else_changes() {
    for (first, then, workers) in [
        (TileSize::Edge(32), TileSize::Edge(32), 2),
        (TileSize::Edge(16), TileSize::Auto, 1),
        (TileSize::Auto, TileSize::Edge(7), 3),
        (TileSize::Edge(1), TileSize::Edge(256), 2),
    ] {
        let at = tempfile::tempdir().unwrap();
        let path = at.path().join("journal");
        let mut kept = 0;
        // Several times, so that what is left is in pieces of pieces. Of tiles of a size that the farm chooses the
        // second could be all that is left: nothing is as quick as this painter.
        let between = if then == TileSize::Auto { TileSize::Edge(24) } else { then };
        let most = if first == TileSize::Auto { 1 } else { 7 };
        for (tile, tiles) in [(first, most), (between, 1), (between, 1)] {
            begin(&path, tile, tiles).await;
            let now = Contents::read(&path).pixels();
            assert!(now > kept, "{first:?}, {then:?}");
            kept = now;
        }
        let shown = Partial::read(&path).unwrap();
        assert_eq!(shown.present.iter().filter(|&&p| p).count() as u64, kept);
        let counted = Counted::default();
        let mut cluster = painted().workers(workers, 1).factory(counted.clone());
        cluster.job.tile = then;
        let journal = journal(&path);
        cluster.job.journal = Some(journal.clone());
        let rendered = cluster.start().await.end().await.unwrap();
        assert_painted(&rendered);
        // At the end, idle workers render what others have not delivered yet: one alone never does.
        let traced = counted.0.load(Ordering::Relaxed);
        let again = (traced + kept).checked_sub(WHOLE.area()).expect("all of it is rendered");
        assert!(again == 0 || (workers > 1 && again < traced), "{first:?}, {then:?}: {again} pixels");
        assert_eq!(rendered.rays.camera + kept, WHOLE.area());
        assert!(rendered.earlier.tiles > 0 && rendered.earlier.tiles < rendered.tiles);
        journal.remove();
        assert!(!path.exists());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_whole_journal_needs_no_worker() {
    let at = tempfile::tempdir().unwrap();
    let path = at.path().join("journal");
    let mut cluster = painted();
    cluster.job.journal = Some(journal(&path));
    let rendered = cluster.start().await.end().await.unwrap();
    assert_painted(&rendered);
    // The picture could not be written, say.
    let mut cluster = painted().workers(0, 1);
    cluster.job.journal = Some(loop {
        // Until the first one's thread has let go of it.
        match Journal::open(&path, false) {
            Ok(journal) => break Arc::new(journal),
            Err(coordinator::journal::JournalError::Busy(_)) => tokio::task::yield_now().await,
            Err(e) => panic!("{e}"),
        }
    });
    let again = cluster.start().await.end().await.unwrap();
    assert_painted(&again);
    assert_eq!(again.earlier.tiles, rendered.tiles);
}

#[test]
fn a_picture_is_finished_though_all_blocking_threads_are_taken() {
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).max_blocking_threads(2).enable_all().build();
    let runtime = runtime.unwrap();
    let (release, held) = tokio::sync::watch::channel(());
    runtime.block_on(async {
        let at = tempfile::tempdir().unwrap();
        let gate = Gate::before(Painted, 3);
        let mut cluster = painted().tile(32).factory(gate.clone());
        cluster.job.journal = Some(journal(&at.path().join("journal")));
        let mut running = cluster.start().await;
        running.until(|p| p.tiles_done >= 3).await;
        // As 540 fetches that nobody reads did.
        for _ in 0..8 {
            let mut held = held.clone();
            tokio::task::spawn_blocking(move || {
                let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
                let _ = runtime.block_on(held.changed());
            });
        }
        gate.open();
        assert_painted(&running.end().await.unwrap());
    });
    drop(release);
}
