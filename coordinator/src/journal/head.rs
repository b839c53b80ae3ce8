//! Which picture a journal is of.

use std::time::Duration;

use tessera_core::film::Region;
use tessera_core::scene::Scene;
use tessera_core::settings::{Sampling, Settings};
use tessera_proto::convert::Malformed;
use tessera_proto::limits::{BUILD, NUMERIC_MODE};
use tessera_proto::scene::describe_parts;
use tessera_proto::{PixelFormat, SceneHash, journal, wire};

use crate::plan::Goal;

/// All that a picture depends on, scene and program included.
#[derive(Clone, Debug, PartialEq)]
pub struct Head {
    build: String,
    numeric_mode: String,
    scene: SceneHash,
    textures: SceneHash,
    pub(super) settings: Settings,
    pub(super) region: Region,
    pub(super) pixels: PixelFormat,
    goal: Goal,
    /// Whether tiles come with what verification needs to go on.
    pub(super) verified: bool,
}

impl Head {
    /// What this program makes of these. Hashing a large scene takes a while.
    pub(crate) fn new(scene: &Scene, settings: Settings, region: Region, pixels: PixelFormat, goal: Goal) -> Self {
        let (scene, textures) = describe_parts(scene);
        let (build, numeric_mode) = (BUILD.into(), NUMERIC_MODE.into());
        Self { build, numeric_mode, scene, textures, settings, region, pixels, goal, verified: false }
    }

    /// The same, of a render whose tiles are verified or not.
    #[must_use]
    pub(crate) fn verified(self, verified: bool) -> Self {
        Self { verified, ..self }
    }

    /// What is not the same in this one, which was found, and in `now`, in a user's words.
    #[must_use]
    pub fn differences(&self, now: &Self) -> Vec<String> {
        let mut found = Vec::new();
        let mut differ = |what: &str, there: String, here: String| {
            if there != here {
                found.push(format!("{what} ({there} there, {here} now)"));
            }
        };
        differ("the program's build", self.build.clone(), now.build.clone());
        differ("the numeric mode", self.numeric_mode.clone(), now.numeric_mode.clone());
        let (there, here) = (&self.settings, &now.settings);
        let size = |s: &Settings| format!("{}x{}", s.view.width(), s.view.height());
        differ("--size", size(there), size(here));
        differ("--zoom", there.view.zoom().to_string(), here.view.zoom().to_string());
        differ("--plane-height", there.view.plane_height().to_string(), here.view.plane_height().to_string());
        differ("--max-depth", there.max_depth.to_string(), here.max_depth.to_string());
        differ("--transfer", there.transfer.name().into(), here.transfer.name().into());
        let region = |r: &Region| format!("{},{},{},{}", r.x0, r.y0, r.x1, r.y1);
        differ("--region", region(&self.region), region(&now.region));
        differ("the accuracy", accuracy(there, self.goal), accuracy(here, now.goal));
        let verify = |verified: bool| if verified { "on" } else { "off" }.to_owned();
        differ("--verify", verify(self.verified), verify(now.verified));
        if there.sampling != here.sampling && accuracy(there, self.goal) == accuracy(here, now.goal) {
            found.push("the accuracy (--quality)".into());
        }
        if self.pixels != now.pixels {
            let depth = |p: PixelFormat| match p {
                PixelFormat::Rgb8 => "8 bits",
                PixelFormat::Rgb16 => "16 bits",
                PixelFormat::F32 => "floats",
            };
            let (there, here) = (depth(self.pixels), depth(now.pixels));
            found.push(format!(
                "the depth of pixels ({there} there, {here} now; --bits, --report and the kind of file decide it)"
            ));
        }
        if self.scene != now.scene {
            found.push("the scene".into());
        }
        if self.textures != now.textures {
            found.push("the scene's pictures".into());
        }
        found
    }
}

/// The accuracy asked for, as flags say it.
fn accuracy(settings: &Settings, goal: Goal) -> String {
    let error = |e: f64| format!("--max-error {}", 255.0 * e);
    match (goal, settings.sampling) {
        (Goal::AsSet, Sampling::Uniform { grid }) => format!("--samples {}", grid * grid),
        (Goal::AsSet, Sampling::Scrambled { samples }) => format!("--samples {samples} --pattern scrambled"),
        (Goal::AsSet, Sampling::Adaptive) => "--quality".into(),
        (Goal::Error(e), _) => error(e),
        (Goal::Time { limit, error: e }, _) => {
            let limit = format!("--time-limit {:.2}s", limit.as_secs_f64());
            e.map_or(limit.clone(), |e| format!("{limit} {}", error(e)))
        }
    }
}

impl From<Head> for journal::Head {
    fn from(head: Head) -> Self {
        let Region { x0, y0, x1, y1 } = head.region;
        let (max_error, limit) = match head.goal {
            Goal::AsSet => (0.0, Duration::ZERO),
            Goal::Error(e) => (e, Duration::ZERO),
            Goal::Time { limit, error } => (error.unwrap_or(0.0), limit),
        };
        Self {
            build: head.build,
            numeric_mode: head.numeric_mode,
            scene_sha256: head.scene.0.into(),
            pictures_sha256: head.textures.0.into(),
            settings: Some(head.settings.into()),
            region: Some(wire::Region { x0, y0, x1, y1 }),
            pixels: wire::PixelFormat::from(head.pixels).into(),
            max_error,
            // A limit that leaves no time is one, too.
            time_limit_us: match head.goal {
                Goal::Time { .. } => super::micros(limit).max(1),
                _ => 0,
            },
            verified: head.verified,
        }
    }
}

impl TryFrom<journal::Head> for Head {
    type Error = Malformed;

    fn try_from(head: journal::Head) -> Result<Self, Malformed> {
        let hash = |bytes: &[u8]| bytes.try_into().map(SceneHash).map_err(|_| Malformed::Range("a hash"));
        let settings = Settings::try_from(head.settings.ok_or(Malformed::Missing("settings"))?)?;
        let wire::Region { x0, y0, x1, y1 } = head.region.ok_or(Malformed::Missing("a region"))?;
        let whole = Region { x0: 0, y0: 0, x1: settings.view.width(), y1: settings.view.height() };
        let region = Region::new(x0, y0, x1, y1).filter(|r| whole.contains(r)).ok_or(Malformed::Range("a region"))?;
        let max_error = head.max_error;
        if !(max_error.is_finite() && max_error >= 0.0) {
            return Err(Malformed::Range("an error"));
        }
        let error = (max_error > 0.0).then_some(max_error);
        Ok(Self {
            scene: hash(&head.scene_sha256)?,
            textures: hash(&head.pictures_sha256)?,
            settings,
            region,
            pixels: head.pixels().try_into()?,
            goal: match (head.time_limit_us, error) {
                (0, None) => Goal::AsSet,
                (0, Some(error)) => Goal::Error(error),
                (limit, error) => Goal::Time { limit: Duration::from_micros(limit), error },
            },
            build: head.build,
            numeric_mode: head.numeric_mode,
            verified: head.verified,
        })
    }
}
