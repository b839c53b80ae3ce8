//! The programs that are compared: how each is given a scene, called and understood.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;
use tessera_core::film::{Image, Metrics, file};
use tessera_core::scene::Scene;
use tessera_core::settings::Settings;
use tessera_tests::peers::povray_installed;

use crate::figures::{Figures, Series};
use crate::process::{Measured, measure};
use crate::scenes::SceneFile;
use crate::{Result, embree, tachyon};

/// The name that all others are compared with.
pub(crate) const TESSERA: &str = "Tessera";

/// One scene to be rendered.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Job<'a> {
    pub(crate) scene: &'a SceneFile,
    pub(crate) settings: &'a Settings,
    pub(crate) threads: u16,
    /// Where programs run, and find and leave their files; absolute.
    pub(crate) folder: &'a Path,
}

/// A ray tracer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Program {
    /// Our coordinator, with two workers in its process.
    Tessera(PathBuf),
    PovRay,
    Tachyon,
    /// A program on Embree, absolute.
    Embree(PathBuf),
}

impl Program {
    /// What there is on this machine, Tessera first; says what is not.
    ///
    /// # Errors
    /// When there is no coordinator, or not the Embree program asked for.
    pub(crate) fn installed(embree: Option<&Path>) -> Result<Vec<Self>> {
        let mut out = vec![Self::Tessera(coordinator()?)];
        let tachyon = || Command::new("tachyon").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok();
        for (program, there) in [(Self::PovRay, povray_installed()), (Self::Tachyon, tachyon())] {
            if there {
                out.push(program);
            } else {
                eprintln!("{} is not installed and left out", program.name());
            }
        }
        match embree {
            Some(path) => {
                let path = path.canonicalize().map_err(|e| format!("no program '{}': {e}", path.display()))?;
                out.push(Self::Embree(path));
            }
            None => eprintln!("Embree is left out: no --embree PROGRAM is given"),
        }
        Ok(out)
    }

    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Tessera(_) => TESSERA,
            Self::PovRay => "POV-Ray",
            Self::Tachyon => "Tachyon",
            Self::Embree(_) => "Embree",
        }
    }

    /// The picture it writes for `scene`.
    pub(crate) fn picture(&self, scene: &str) -> String {
        match self {
            Self::Embree(_) => format!("{scene}-embree.pfm"),
            _ => format!("{scene}-{}.png", self.name().to_lowercase()),
        }
    }

    /// Writes the scene's file in this program's own language, where it has one.
    ///
    /// # Errors
    /// What writing files can meet.
    pub(crate) fn export(&self, scene: &Scene, job: &Job<'_>) -> Result<()> {
        let create = |extension: &str| {
            File::create(job.folder.join(format!("{}.{extension}", job.scene.name))).map(BufWriter::new)
        };
        match self {
            Self::Tessera(_) => {}
            Self::PovRay => drop(coordinator::povray::export(scene, job.settings, job.folder, &job.scene.name)?),
            Self::Tachyon => {
                let mut out = create("dat")?;
                tachyon::write(scene, job.settings, &mut out)?;
                out.flush()?;
            }
            Self::Embree(_) => {
                let mut out = create("bin")?;
                embree::write(scene, job.settings, &mut out)?;
                out.flush()?;
            }
        }
        Ok(())
    }

    fn command(&self, job: &Job<'_>) -> Command {
        let (name, view, threads) = (&job.scene.name, &job.settings.view, job.threads.to_string());
        let (width, height, depth) =
            (view.width().to_string(), view.height().to_string(), job.settings.max_depth.to_string());
        let picture = self.picture(name);
        let mut command = match self {
            Self::Tessera(path) => {
                let mut c = Command::new(path);
                c.arg("render").arg(&job.scene.path).args(["-o", &picture, "--samples", "1"]);
                c.args(["--workers", "2", "--threads", &threads, "--size", &format!("{width}x{height}")]);
                c.args(["--max-depth", &depth, "--zoom", &format!("{:e}", view.zoom())]);
                c.args(["--transfer", "linear", "--progress", "none"]);
                c
            }
            Self::PovRay => {
                let mut c = Command::new("povray");
                c.arg(format!("+I{name}.pov")).arg(format!("+O{picture}")).arg(format!("+WT{threads}"));
                c.arg(format!("+W{width}")).arg(format!("+H{height}"));
                c.args(["+FN8", "-D", "-A", "-V", "File_Gamma=1.0"]);
                c
            }
            Self::Tachyon => {
                let mut c = Command::new("tachyon");
                c.arg(format!("{name}.dat")).args(["-res", &width, &height, "-format", "PNG", "-o", &picture]);
                c.args(["-numthreads", &threads, "-raydepth", &depth]);
                c
            }
            Self::Embree(path) => {
                let mut c = Command::new(path);
                c.arg(format!("{name}.bin")).args([&width, &height, &picture]).args(["16", "1"]);
                c.env("OMP_NUM_THREADS", threads);
                c
            }
        };
        command.current_dir(job.folder).env_remove("RUST_LOG");
        command
    }

    /// Renders the job once.
    ///
    /// # Errors
    /// When the program fails or does not say what is expected of it.
    pub(crate) fn run(&self, job: &Job<'_>) -> Result<Figures> {
        let Measured { whole, peak, text } =
            measure(&mut self.command(job)).map_err(|e| format!("{}: {e}", self.name()))?;
        let mut figures = Figures::from([("whole", whole.as_secs_f64())]);
        figures.extend(peak.map(|bytes| ("peak", bytes as f64)));
        match self {
            // A report asks for floats and their hash, which no peer writes: phases are another run's.
            Self::Tessera(_) => {
                let mut command = self.command(job);
                command.args(["--report", &report(&job.scene.name)]);
                measure(&mut command).map_err(|e| format!("{}: {e}", self.name()))?;
                read_report(&job.folder.join(report(&job.scene.name)), &mut figures)?;
            }
            Self::PovRay => figures.extend(number_after(&text, &["Trace Time", "("]).map(|s| ("trace", s))),
            Self::Tachyon => figures.extend(number_after(&text, &["Ray Tracing Time:"]).map(|s| ("trace", s))),
            Self::Embree(_) => {
                figures.extend(number_after(&text, &["render "]).map(|s| ("trace", s)));
                figures.extend(number_after(&text, &["build "]).map(|s| ("build", s)));
            }
        }
        if figures.contains_key("trace") {
            Ok(figures)
        } else {
            Err(format!("{} did not say how long it traced", self.name()).into())
        }
    }
}

/// The coordinator beside this program, brought up to date where cargo started it.
fn coordinator() -> Result<PathBuf> {
    let here = std::env::current_exe()?;
    let folder = here.parent().ok_or("this program is in no folder")?;
    let path = folder.join(format!("coordinator{}", std::env::consts::EXE_SUFFIX));
    if let (Some(cargo), Some(target), true) = (std::env::var_os("CARGO"), folder.parent(), folder.ends_with("release"))
    {
        let manifest = Path::new(env!("CARGO_MANIFEST_DIR")).join("../Cargo.toml");
        let built = Command::new(cargo)
            // Both packages, so that dependencies have the features that they have for this program.
            .args(["build", "--release", "--package", "tessera-tests", "--package", "coordinator"])
            .args(["--bin", "coordinator", "--manifest-path"])
            .arg(manifest)
            .arg("--target-dir")
            .arg(target)
            .status()?;
        if !built.success() {
            return Err("the coordinator does not build".into());
        }
    }
    if path.is_file() {
        Ok(path)
    } else {
        Err(format!("no '{}'; 'cargo build --release' makes it", path.display()).into())
    }
}

fn report(scene: &str) -> String {
    format!("{scene}-report.json")
}

fn read_report(path: &Path, figures: &mut Figures) -> Result<()> {
    let report: Value = serde_json::from_str(&std::fs::read_to_string(path)?)?;
    for phase in ["read", "build", "trace", "write"] {
        figures.extend(report["seconds"][phase].as_f64().map(|s| (phase, s)));
    }
    figures.extend(report["rays"]["total"].as_f64().map(|n| ("rays", n)));
    figures.extend(report["rays"]["refined"].as_f64().map(|n| ("refined", n)));
    Ok(())
}

/// The number that follows all of `marks`, found one after the other.
fn number_after(text: &str, marks: &[&str]) -> Option<f64> {
    let rest = marks.iter().try_fold(text, |rest, mark| Some(rest.split_once(mark)?.1))?.trim_start();
    rest[..rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len())].parse().ok()
}

/// Notes with every peer how far its last picture is from ours.
pub(crate) fn compare(programs: &[Program], job: &Job<'_>, series: &mut [(&'static str, Option<Series>)]) {
    let picture = |p: &Program| -> Result<Image> {
        let path = job.folder.join(p.picture(&job.scene.name));
        let stored = file::read(&path).map_err(|e| format!("{}: {e}", path.display()))?;
        // All of them hold linear numbers, whatever their files say of them.
        Ok(stored.image.map(|x| x.clamp(0.0, 1.0)))
    };
    let mut ours = None;
    for (program, (_, series)) in programs.iter().zip(series) {
        let Some(series) = series else { continue };
        match (picture(program), &ours) {
            (Ok(image), None) => ours = Some(image),
            (Ok(image), Some(ours)) if (image.width(), image.height()) == (ours.width(), ours.height()) => {
                let apart = Metrics::measure(&image, ours);
                series.note("rmse", apart.rmse);
                series.note("off", apart.beyond_255th);
            }
            (Ok(_), Some(_)) => eprintln!("{}'s picture has another size", program.name()),
            (Err(e), _) => eprintln!("{}'s picture is not compared: {e}", program.name()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_found_in_what_programs_say() {
        let povray = "Render Time:\n  Trace Time:       0 hours  1 minutes  0 seconds (60.639 seconds)\n   using 2";
        assert_eq!(number_after(povray, &["Trace Time", "("]), Some(60.639));
        assert_eq!(number_after("  Ray Tracing Time:     0.2176 seconds\n", &["Ray Tracing Time:"]), Some(0.2176));
        assert_eq!(number_after("build 0.157 render 0.1543 s  rays 25", &["render "]), Some(0.1543));
        assert_eq!(number_after("nothing", &["render "]), None);
    }
}
