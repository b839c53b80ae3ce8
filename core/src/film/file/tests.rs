use std::path::PathBuf;

use super::*;
use crate::film::image::PixelsRef;
use crate::film::{encode, transfer};
use crate::settings::Transfer;

/// Something of everything: ramps, flat parts, values out of range.
fn pixels(width: u32, height: u32) -> Vec<[f32; 3]> {
    (0..width * height)
        .map(|i| {
            let (x, y) = ((i % width) as f32 / width as f32, (i / width) as f32 / height as f32);
            if x < 0.3 { [0.25, 0.5, 1.0] } else { [x * y, 1.5 * x - 0.2, (x * 37.0).fract() * y] }
        })
        .collect()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn codes_return_from_their_files() {
    let folder = folder();
    let linear = pixels(61, 17);
    for (name, transfer) in [("a.png", Transfer::Srgb), ("b.png", Transfer::Linear), ("c.ppm", Transfer::Srgb)] {
        for depth in [Depth::Eight, Depth::Sixteen] {
            let path = folder.path().join(name);
            Output::plan(&path, depth, transfer).unwrap().write(61, 17, PixelsRef::F32(&linear)).unwrap();
            let stored = read(&path).unwrap();
            assert_eq!(stored.transfer, Some(transfer), "{name}");
            assert_eq!((stored.image.width(), stored.image.height()), (61, 17));
            let max = if depth == Depth::Eight { 255.0 } else { 65535.0 };
            let codes: Vec<[u16; 3]> = if depth == Depth::Eight {
                encode::to_bytes(transfer, &linear).iter().map(|p| p.map(u16::from)).collect()
            } else {
                encode::to_words(transfer, &linear)
            };
            let back: Vec<[u16; 3]> =
                stored.image.pixels().iter().map(|p| p.map(|x| (x * max).round() as u16)).collect();
            assert_eq!(back, codes, "{name} {depth:?}");
        }
    }
}

/// Gives a picture that is in memory a few rows at a time.
struct InMemory(Vec<[f32; 3]>);

impl Rows for InMemory {
    fn rows(
        &self,
        width: u32,
        rows: std::ops::Range<u32>,
        take: &mut dyn FnMut(PixelsRef<'_>) -> std::io::Result<()>,
    ) -> std::io::Result<()> {
        take(PixelsRef::F32(&self.0[(rows.start * width) as usize..(rows.end * width) as usize]))
    }
}

#[test]
fn rows_that_are_written_bit_by_bit_make_the_same_picture() {
    let folder = folder();
    // Three bands.
    let (width, height) = (10_007, 211);
    let linear = pixels(width, height);
    let source = InMemory(linear.clone());
    for name in ["a.png", "a.ppm", "a.pfm", "a.exr"] {
        for depth in [Depth::Eight, Depth::Sixteen] {
            let [whole, rows] = ["whole-", "rows-"].map(|kind| folder.path().join(format!("{kind}{name}")));
            let plan = |path: &Path| Output::plan(path, depth, Transfer::Srgb).unwrap();
            plan(&whole).write(width, height, PixelsRef::F32(&linear)).unwrap();
            plan(&rows).write_rows((width, height), &source).unwrap();
            let reserved = plan(&folder.path().join(format!("reserved-{name}")));
            let room = reserved.reserve(width, height).unwrap();
            reserved.write_rows_reserved(room, (width, height), &source, false).unwrap();
            assert!(std::fs::read(reserved.path()).unwrap() == std::fs::read(&rows).unwrap(), "{name} {depth:?}");
            let [whole, rows] = [whole, rows].map(|path| read(&path).unwrap());
            assert!(whole.image == rows.image && whole.transfer == rows.transfer, "{name} {depth:?}");
        }
    }
}

#[test]
fn floats_return_bit_for_bit() {
    let folder = folder();
    let mut linear = pixels(33, 9);
    linear[5] = [1e-30, -7.0, 65504.5];
    for name in ["a.pfm", "a.exr", "B.EXR"] {
        let path = folder.path().join(name);
        Output::plan(&path, Depth::Eight, Transfer::Srgb).unwrap().write(33, 9, PixelsRef::F32(&linear)).unwrap();
        let stored = read(&path).unwrap();
        assert_eq!((stored.transfer, stored.image.pixels() == linear), (None, true), "{name}");
    }
}

#[test]
fn a_float_map_runs_from_the_bottom() {
    let folder = folder();
    let path = folder.path().join("a.pfm");
    let output = Output::plan(&path, Depth::Eight, Transfer::Srgb).unwrap();
    output.write(1, 2, PixelsRef::F32(&[[1.0; 3], [2.0; 3]])).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let mut expected = b"PF\n1 2\n-1.0\n".to_vec();
    expected.extend([2.0_f32, 2.0, 2.0, 1.0, 1.0, 1.0].iter().flat_map(|x| x.to_le_bytes()));
    assert_eq!(bytes, expected);
    std::fs::write(&path, b"Pf 1 2 1.0\n\x40\x00\x00\x00\x3f\x80\x00\x00").unwrap();
    assert_eq!(read(&path).unwrap().image.pixels(), [[1.0; 3], [2.0; 3]]);
}

#[test]
fn a_bad_place_is_known_before_anything_is_written() {
    let folder = folder();
    let why = |name: &str| {
        let path = folder.path().join(name);
        Output::plan(&path, Depth::Eight, Transfer::Srgb).unwrap_err().to_string()
    };
    std::fs::create_dir(folder.path().join("sub.png")).unwrap();
    std::fs::write(folder.path().join("file"), "").unwrap();
    assert!(why("a.jpg").contains("ends in .jpg, which is no kind of picture"), "{}", why("a.jpg"));
    assert!(why("a").contains("has no extension"));
    assert!(why("none/a.png").contains("does not exist"));
    assert!(why("file/a.png").contains("not a folder"));
    assert!(why("sub.png").contains("exists and is a folder"));
    assert_eq!(names(folder.path()), ["file", "sub.png"]);
}

#[test]
fn what_fails_leaves_the_old_picture_and_nothing_else() {
    let folder = folder();
    let path = folder.path().join("a.png");
    std::fs::write(&path, "old").unwrap();
    let output = Output::plan(&path, Depth::Eight, Transfer::Srgb).unwrap();
    assert!(output.write(2, 2, PixelsRef::F32(&[[0.0; 3]; 3])).is_err());
    assert!(output.write(2, 2, PixelsRef::Rgb16(&[[0; 3]; 4])).is_err());
    assert_eq!(std::fs::read(&path).unwrap(), b"old");
    assert_eq!(names(folder.path()), ["a.png"]);
    output.write(1, 1, PixelsRef::Rgb8(&[[1, 2, 3]])).unwrap();
    assert_eq!(names(folder.path()), ["a.png"]);
    assert_eq!(output.partial().path(), folder.path().join("a.partial.png"));
}

#[cfg(unix)]
#[test]
fn a_link_stays_a_link() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("there")).unwrap();
    std::fs::write(folder.path().join("there/real.png"), "old").unwrap();
    let link = folder.path().join("link.png");
    std::os::unix::fs::symlink("there/real.png", &link).unwrap();
    Output::plan(&link, Depth::Eight, Transfer::Srgb).unwrap().write(1, 1, PixelsRef::Rgb8(&[[1, 2, 3]])).unwrap();
    assert!(link.is_symlink());
    assert_eq!(read(&folder.path().join("there/real.png")).unwrap().image.width(), 1);
}

#[test]
fn broken_files_say_why() {
    let folder = folder();
    let why = |name: &str, bytes: &[u8]| {
        let path: PathBuf = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        read(&path).unwrap_err().to_string()
    };
    assert!(why("a.gif", b"").contains("extension"));
    assert!(why("a.pfm", b"PF\n3 3\n-1.0\nabc").contains("truncated"));
    assert!(why("a.pfm", b"PF\n99999 99999\n-1.0\n").contains("above the limit"));
    assert!(why("a.pfm", b"PF\n0 3\n-1.0\n").contains("empty"));
    assert!(why("a.pfm", b"PF\n1 1\n0\n").contains("scale"));
    assert!(why("a.pfm", b"P6\n1 1\n0\n").contains("begins with 'P6'"));
    assert!(!why("a.png", b"nothing like it").is_empty());
    assert!(!why("a.exr", b"nothing like it").is_empty());
    let path = folder.path().join("whole.exr");
    for (name, kind) in [("whole.exr", "exr"), ("whole.png", "png")] {
        let path = folder.path().join(name);
        let output = Output::plan(&path, Depth::Eight, Transfer::Srgb).unwrap();
        output.write(9, 9, PixelsRef::F32(&pixels(9, 9))).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for cut in [bytes.len() - 20, bytes.len() / 2, 10] {
            assert!(!why(&format!("cut.{kind}"), &bytes[..cut]).is_empty());
        }
    }
    assert!(read(&path.with_file_name("none.png")).unwrap_err().to_string().contains("cannot be read"));
    assert!(read(folder.path()).is_err());
}

#[test]
fn numbers_change_their_meaning_when_asked() {
    let image = crate::film::Image::new(1, 1, vec![[0.5, 2.0, 0.0]]).unwrap();
    let stored = Stored { image, transfer: None };
    assert_eq!(stored.clone().in_transfer(Transfer::Linear).pixels(), [[0.5, 2.0, 0.0]]);
    let half = transfer::from_linear(Transfer::Srgb, 0.5) as f32;
    assert_eq!(stored.in_transfer(Transfer::Srgb).pixels(), [[half, 1.0, 0.0]]);
}

#[test]
#[ignore = "prints times"]
fn times() {
    let folder = folder();
    let linear = pixels(1280, 960);
    for (name, depth) in [
        ("a.png", Depth::Eight),
        ("b.png", Depth::Sixteen),
        ("a.ppm", Depth::Eight),
        ("a.pfm", Depth::Eight),
        ("a.exr", Depth::Eight),
    ] {
        for _ in 0..3 {
            let path = folder.path().join(name);
            let output = Output::plan(&path, depth, Transfer::Srgb).unwrap();
            let (bytes, words);
            let p = match (output.kind().is_float(), depth) {
                (true, _) => PixelsRef::F32(&linear),
                (_, Depth::Eight) => {
                    bytes = encode::to_bytes(Transfer::Srgb, &linear);
                    PixelsRef::Rgb8(&bytes)
                }
                _ => {
                    words = encode::to_words(Transfer::Srgb, &linear);
                    PixelsRef::Rgb16(&words)
                }
            };
            let now = std::time::Instant::now();
            output.write(1280, 960, p).unwrap();
            println!("{name} {depth:?}: {:?}, {} bytes", now.elapsed(), std::fs::metadata(&path).unwrap().len());
        }
    }
}

/// A small generator of numbers that look random (Marsaglia's xorshift), always the same.
struct Noise(u64);

impl Noise {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % n
    }
}

#[test]
fn damaged_files_are_read_or_refused() {
    let folder = folder();
    let mut noise = Noise(0x9e37_79b9_7f4a_7c15);
    for (name, depth) in [
        ("a.png", Depth::Eight),
        ("b.png", Depth::Sixteen),
        ("a.ppm", Depth::Sixteen),
        ("a.pfm", Depth::Eight),
        ("a.exr", Depth::Eight),
    ] {
        let path = folder.path().join(name);
        let output = Output::plan(&path, depth, Transfer::Srgb).unwrap();
        output.write(13, 7, PixelsRef::F32(&pixels(13, 7))).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let mut refused = 0;
        for _ in 0..300 {
            let mut bytes = whole.clone();
            for _ in 0..=noise.below(3) {
                // The header is where the harm is.
                let at = if noise.below(2) == 0 { noise.below(bytes.len()) } else { noise.below(bytes.len().min(400)) };
                bytes[at] = noise.below(256) as u8;
            }
            if noise.below(5) == 0 {
                bytes.truncate(noise.below(bytes.len()));
            }
            std::fs::write(&path, bytes).unwrap();
            // Neither a panic nor, at these sizes, more memory than a test may take.
            refused += u32::from(read(&path).is_err());
        }
        assert!(refused > 20, "{name}: {refused} refused");
    }
}

#[test]
fn float_maps_with_line_ends_of_two_bytes_are_read() {
    let folder = folder();
    let path = folder.path().join("a.pfm");
    let floats: Vec<u8> = [0.25_f32, 0.5, 1.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    for header in ["PF\n1 1\n-1.0\n", "PF\r\n1 1\r\n-1.0\r\n"] {
        std::fs::write(&path, [header.as_bytes(), &floats].concat()).unwrap();
        assert_eq!(read(&path).unwrap().image.pixels(), [[0.25, 0.5, 1.0]], "{header:?}");
    }
}

#[test]
fn exr_files_of_grey_alone_are_grey_and_others_are_named() {
    use ::exr::prelude::{Image, SpecificChannels, WritableImage};
    let folder = folder();
    let path = folder.path().join("a.exr");
    let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(|_| (0.5_f32,));
    Image::from_channels((2, 1), channels).write().to_file(&path).unwrap();
    assert_eq!(read(&path).unwrap().image.pixels(), [[0.5; 3]; 2]);
    let channels = SpecificChannels::build().with_channel("Z").with_pixel_fn(|_| (0.5_f32,));
    Image::from_channels((2, 1), channels).write().to_file(&path).unwrap();
    let why = read(&path).unwrap_err().to_string();
    assert!(why.contains("it has Z") && why.contains("R, G and B"), "{why}");
}
