use super::*;
use crate::Pixels;

fn settings() -> Settings {
    Settings {
        view: View::new(640, 480, 1.5, 0.75).unwrap(),
        max_depth: 7,
        sampling: Sampling::Uniform { grid: 3 },
        transfer: Transfer::Linear,
    }
}

#[test]
fn a_job_survives_the_wire() {
    for scene in [None, Some((SceneHash([7; 32]), 1234))] {
        for sampling in [settings().sampling, Sampling::Scrambled { samples: 5 }, Sampling::Adaptive] {
            let settings = Settings { sampling, ..settings() };
            let job = Job { number: JobNumber(7), scene, settings, pixels: PixelFormat::Rgb16 };
            assert_eq!(Job::try_from(wire::Job::from(job.clone())).unwrap(), job);
        }
    }
}

#[test]
fn settings_of_a_peer_are_checked() {
    let good = wire::Settings::from(settings());
    for bad in [
        wire::Settings { width: 0, ..good },
        wire::Settings { height: u32::MAX, ..good },
        wire::Settings { zoom: f64::NAN, ..good },
        wire::Settings { plane_height: -1.0, ..good },
        wire::Settings { max_depth: 0, ..good },
        wire::Settings { sampling: None, ..good },
        wire::Settings { sampling: Some(wire::settings::Sampling::Grid(0)), ..good },
        wire::Settings { sampling: Some(wire::settings::Sampling::Grid(65)), ..good },
        wire::Settings { sampling: Some(wire::settings::Sampling::Scrambled(0)), ..good },
        wire::Settings { sampling: Some(wire::settings::Sampling::Scrambled(4097)), ..good },
        wire::Settings { transfer: 9, ..good },
    ] {
        assert!(Settings::try_from(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn regions_of_a_peer_are_checked() {
    let region = |x0, y0, x1, y1| Region::try_from(wire::Region { x0, y0, x1, y1 });
    assert!(region(0, 0, 256, 256).is_ok());
    assert!(region(0, 0, 257, 256).is_err());
    assert!(region(5, 0, 5, 1).is_err());
    assert!(region(0, 0, u32::MAX, u32::MAX).is_err());
}

#[test]
fn leases_survive_the_wire_and_are_checked() {
    use wire::lease::Detail as Wire;
    let region = Region::new(8, 16, 24, 32).unwrap();
    let lease = |pass| Lease { id: LeaseId(3), attempt: Attempt(1), region, number: PassNumber(2), pass };
    let within = |billionths| Detail::Within(Tolerance::from_billionths(billionths));
    let glance = |billionths| Detail::Glance(Tolerance::from_billionths(billionths));
    let coarse = [2, 64].map(|step| Detail::Coarse { step });
    for detail in coarse.into_iter().chain([within(1000), within(4_000_000_000), glance(1000)]) {
        for audit in [AuditRate::default(), AuditRate(7), AuditRate::ALL] {
            let lease = lease(Some(Pass { detail, audit }));
            assert_eq!(Lease::try_from(wire::Lease::from(lease)), Ok(lease));
        }
    }
    let plain = wire::Lease::from(lease(None));
    assert_eq!(Lease::try_from(plain), Ok(lease(None)));
    for bad in [
        wire::Lease { audit_rate: 1, ..plain },
        wire::Lease { region: None, ..plain },
        wire::Lease { detail: Some(Wire::CoarseStep(1)), ..plain },
        wire::Lease { detail: Some(Wire::CoarseStep(65)), ..plain },
        wire::Lease { detail: Some(Wire::ToleranceBillionths(999)), ..plain },
        wire::Lease { detail: Some(Wire::ToleranceBillionths(u32::MAX)), ..plain },
        wire::Lease { detail: Some(Wire::GlanceBillionths(999)), ..plain },
    ] {
        assert!(Lease::try_from(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn errors_survive_the_wire_and_are_checked() {
    for units in [0, 1, -1, 1 << 64, -(1 << 64), i128::MAX, i128::MIN, 3 << 63, -(3 << 63)] {
        let error = ErrorEstimate {
            pixels: 64,
            expected: Sum(units.max(0)),
            audited: 64,
            squares: Sum(units),
            variance: Sum(units.max(0)),
        };
        assert_eq!(ErrorEstimate::try_from(wire::ErrorEstimate::from(error)), Ok(error));
    }
    let good = wire::ErrorEstimate { pixels: 8, audited: 2, ..Default::default() };
    let (below, above) = (Some(wire::Sum { high: -1, low: 5 }), Some(wire::Sum { high: 0, low: 5 }));
    assert!(ErrorEstimate::try_from(wire::ErrorEstimate { squares: below, ..good }).is_ok());
    for bad in [
        wire::ErrorEstimate { pixels: 1 << 40, ..good },
        wire::ErrorEstimate { audited: 9, ..good },
        wire::ErrorEstimate { expected: below, ..good },
        wire::ErrorEstimate { variance: below, ..good },
        wire::ErrorEstimate { audited: 0, squares: above, ..good },
        wire::ErrorEstimate { audited: 0, variance: above, ..good },
    ] {
        assert!(ErrorEstimate::try_from(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn pixels_survive_the_wire_in_every_format() {
    let region = Region::new(3, 4, 5, 5).unwrap();
    for pixels in [
        Pixels::Rgb8(vec![[1, 2, 3], [4, 5, 255]]),
        Pixels::Rgb16(vec![[1, 2, 300], [4, 5, u16::MAX]]),
        Pixels::F32(vec![[0.0, -0.0, 1e-40], [1.5, 1e30, 0.1]]),
    ] {
        let (bytes, format) = (pixel_bytes(&pixels), pixels.format());
        assert_eq!(check_pixels(&bytes, format), Ok(()));
        assert_eq!(check_size(&bytes, format, &region), Ok(()));
        let mut back = Pixels::black(format, 4).unwrap();
        back.put(1, &bytes);
        let mut wanted = Pixels::black(format, 1).unwrap();
        match (&mut wanted, &pixels) {
            (Pixels::Rgb8(w), Pixels::Rgb8(p)) => w.extend(p),
            (Pixels::Rgb16(w), Pixels::Rgb16(p)) => w.extend(p),
            (Pixels::F32(w), Pixels::F32(p)) => w.extend(p),
            _ => unreachable!(),
        }
        match &mut wanted {
            Pixels::Rgb8(w) => w.push([0; 3]),
            Pixels::Rgb16(w) => w.push([0; 3]),
            Pixels::F32(w) => w.push([0.0; 3]),
        }
        assert_eq!(back, wanted);
        assert!(check_size(&bytes[..bytes.len() / 2], format, &region).is_err());
        assert!(check_pixels(&bytes[1..], format).is_err());
        assert!(check_pixels(&[], format).is_err());
        assert!(check_pixels(&vec![0; format.bytes_per_pixel() * 65_537], format).is_err());
    }
    for bad in [f32::NAN, f32::INFINITY] {
        let bytes = pixel_bytes(&Pixels::F32(vec![[0.0; 3], [0.0, bad, 0.0]]));
        assert_eq!(check_pixels(&bytes, PixelFormat::F32), Err(Malformed::NotFinite));
    }
}

#[test]
fn a_registration_is_checked_and_made_presentable() {
    let good = wire::Register::from(Registration {
        name: "w1".into(),
        threads: 2,
        id: WorkerId([5; 32]),
        proof: vec![6; 64],
        local: Some(Secret::from([1; 16])),
    });
    assert_eq!(check_match(&good), Ok(()));
    let old = wire::Register { protocol: 0, ..good.clone() };
    assert_eq!(check_match(&old), Err(Mismatch::Protocol(0)));
    assert!(check_match(&wire::Register { build: "0".into(), ..good.clone() }).is_err());
    assert!(check_match(&wire::Register { numeric_mode: "f32".into(), ..good.clone() }).is_err());
    assert!(Registration::try_from(wire::Register { threads: 0, ..good.clone() }).is_err());
    assert!(Registration::try_from(wire::Register { threads: 1 << 20, ..good.clone() }).is_err());
    assert!(Registration::try_from(wire::Register { key: vec![1; 31], ..good.clone() }).is_err());
    assert!(Registration::try_from(wire::Register { local: vec![1], ..good.clone() }).is_err());
    assert!(Registration::try_from(wire::Register { name: "x".repeat(65), ..good.clone() }).is_err());
    let odd = Registration::try_from(wire::Register { name: "a\u{1b}[2Jb\n".into(), ..good }).unwrap();
    assert!(!odd.name.chars().any(char::is_control));
}
