//! What is known of one pixel's mean, and how many points it is worth.

use glam::DVec3;

use crate::settings::Tolerance;

/// Points of a pixel at most.
pub(crate) const MOST: u32 = 1 << 16;

/// Constants of the model of errors.
///
/// A mean over n points of a scrambled net errs by κ·n^-1.5 (mean square) once points are closer than edges. *Fitted*
/// values are measured anew by `cargo xtask calibrate`; *chosen* ones weigh costs against each other.
#[derive(Clone, Copy, Debug)]
pub struct Model {
    /// κ of a pixel of variance 1, as long as nothing else is known. Fitted to straight edges whose distance from the
    /// pixel's middle is even (16 points: 9.8 steps of 255). Of random lines, which clip corners too, it is 0.70: more
    /// of a smaller variance.
    pub edge: f64,
    /// κ of the edge whose error the tolerance states: half a contrast of 1, wherever it passes. Fitted: 0.095 of edges
    /// whose mean variance is a sixth, 0.092 of random lines.
    pub typical: f64,
    /// What takes off less than this share of a pixel's points is left alone. Chosen: points are doubled at least.
    pub least_growth: f64,
    /// What may hide where all points are alike: this much over the square of their number, times the square of how
    /// much may hide. Chosen: for an error of a quarter of a step in 255 the first four points are enough, and for a
    /// twentieth some fifty.
    pub hidden: f64,
    /// What may hide of an edge that seems to lie between two pixels, as above, times the square of its contrast; and
    /// what of it is to be expected. Chosen: it lies in either, between the pixel's edge and the first point, which
    /// would be a sixth; twice that takes the fewest points to an error, and an eighth of it is seen in the mean.
    pub beside: (f64, f64),
    /// Mean square that a point must take off at a tolerance of four steps in 255, which leads to a picture's error
    /// of half a step or so. Follows from [`Self::typical`].
    pub loose_point: f64,
    /// The same of ten steps, rounded: the tolerance is loose above it.
    pub loose: f64,
    /// The same of one step, rounded: the tolerance is tight below it.
    pub tight: f64,
    /// Points that a pixel begins with in which anything may be seen, where the tolerance is loose and where it is
    /// not. Chosen: the least that have a variance, and enough to miss little.
    pub first: [u32; 2],
    /// Objects that a tile is proven among at most, where the tolerance is tight, and where it is not. Chosen: a proof
    /// among many costs more than the points that it saves, but where a pixel gets hundreds.
    pub candidates: [usize; 2],
    /// Points of a ball that is alone in its pixel at [`Self::loose_point`], and the power of the tolerance's points
    /// by which they grow. Chosen: even a thin crescent's light is known to a hundredth.
    pub lone_ball: (f64, f64),
}

const MODEL: Model = Model {
    edge: 0.57,
    typical: 0.1,
    least_growth: 1.4,
    hidden: 1e-4,
    beside: (0.33, 0.04),
    loose_point: 2.9e-6,
    loose: 6e-5,
    tight: 3e-8,
    first: [2, 4],
    candidates: [48, 16],
    lone_ball: (64.0, 0.56),
};

impl Tolerance {
    /// What a tolerance means: the model by which points are given out, so that it leads to errors.
    pub const MODEL: Model = MODEL;

    /// Points of the edge whose error it states: those at which κ·n^-1.5 is its square.
    #[must_use]
    pub fn typical_points(self) -> f64 {
        libm::pow(MODEL.typical / (self.fraction() * self.fraction()), 2.0 / 3.0)
    }
}

/// κ of an edge on whose sides colours are off by so much from their mean, wherever it passes.
fn edge(contrast: f64) -> f64 {
    // Its variance is 4·contrast²·p(1 − p), p(1 − p) being a sixth in the mean.
    MODEL.edge * contrast * contrast * (2.0 / 3.0)
}

/// Of the error's mean square, what doubling the points takes off: 1 − 2^-1.5.
const DOUBLING: f64 = 0.646_446_609_406_726_2;

/// How many points pixels are worth under a tolerance.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    /// Mean square that a point must take off to be worth it.
    a_point: f64,
    /// Below such doubts a pixel begins with one point, or with two.
    few: [f64; 2],
    /// Points that others begin with.
    first: u32,
}

impl Rule {
    /// Such that a typical edge ends with the tolerance's error.
    pub(crate) fn new(tolerance: Tolerance) -> Self {
        let t = tolerance.fraction();
        // κ n^-1.5 = t² and DOUBLING · κ n^-2.5 = a_point at κ = typical.
        let a_point = DOUBLING * t * t / tolerance.typical_points();
        // Doubts whose edge is worth so many points.
        let few = [1.0, 2.0].map(|points| {
            let n: f64 = MODEL.least_growth * points;
            (a_point * n * n * n.sqrt() / (DOUBLING * edge(1.0))).sqrt()
        });
        Self { a_point, few, first: MODEL.first[usize::from(a_point < MODEL.loose)] }
    }

    /// Objects that a tile is proven among at most.
    pub(crate) fn candidates(&self) -> usize {
        MODEL.candidates[usize::from(self.a_point > MODEL.tight)]
    }

    /// Points of a pixel of such κ.
    pub(crate) fn points(&self, kappa: f64) -> f64 {
        libm::pow(DOUBLING * kappa / self.a_point, 0.4)
    }

    /// Points that a pixel begins with in which so much, a part of full scale, may hide: a small contrast is not
    /// worth all of them.
    pub(crate) fn first(&self, doubt: f64) -> u32 {
        match self.few {
            [one, _] if doubt < one => 1,
            [_, two] if doubt < two => 2,
            _ => self.first,
        }
    }

    /// Points of a ball that is alone in its pixel: 64 at half a step in 255, so many more within tighter tolerances
    /// that even a thin crescent's light is known to a hundredth.
    pub(crate) fn lone_ball(&self) -> u32 {
        let (least, power) = MODEL.lone_ball;
        let times = libm::pow(MODEL.loose_point / self.a_point, power);
        ((least * times).clamp(least, 16384.0) as u32).next_power_of_two()
    }
}

/// The samples of one pixel, in the order of its sequence.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pixel {
    sum: DVec3,
    /// Sum of the squares of all components.
    squares: f64,
    pub(crate) points: u32,
    /// The next of the sequence: more than `points` where some did not count.
    pub(crate) next: u32,
    /// See [`Model`]; what it was inferred from weighs as much as so many doublings.
    kappa: f64,
    weight: f64,
    /// How much may hide in it, as a part of full scale.
    doubt: f64,
    /// The square of the contrast with which an edge seems to lie between it and a pixel beside it.
    step: f64,
}

impl Pixel {
    /// A pixel whose mean is known.
    pub(crate) fn known(mean: DVec3) -> Self {
        Self { sum: mean, points: 1, next: 1, ..Self::default() }
    }

    /// A pixel in which so much may hide, before its first samples.
    pub(crate) fn doubted(doubt: f64) -> Self {
        Self { doubt, ..Self::default() }
    }

    /// Whether its mean is known without more ado.
    pub(crate) fn is_known(&self) -> bool {
        self.points == 1 && self.doubt == 0.0
    }

    /// Whether it has samples enough for a variance that tells something.
    pub(crate) fn has_variance(&self) -> bool {
        self.points > 1
    }

    /// Adds samples that are the next of the pixel's sequence, which were `taken` in all. They double their number,
    /// or are the first.
    pub(crate) fn add(&mut self, taken: u32, samples: impl Iterator<Item = DVec3>) {
        self.next += taken;
        let (mut sum, mut squares, mut n) = (DVec3::ZERO, 0.0, 0);
        for x in samples {
            sum += x;
            squares += x.length_squared();
            n += 1;
        }
        if self.points > 0 && n > 0 {
            // Two nets of as many points, that know nothing of each other but not to meet.
            let half = f64::from(self.points);
            let apart = (sum * (1.0 / f64::from(n)) - self.mean()).length_squared() / 3.0;
            let seen = 0.5 * apart * half * half.sqrt();
            self.kappa = (self.kappa * self.weight + seen) / (self.weight + 1.0);
            self.weight = (self.weight + 1.0).min(3.0);
        }
        self.sum += sum;
        self.squares += squares;
        self.points += n;
    }

    pub(crate) fn mean(&self) -> DVec3 {
        self.sum * (1.0 / f64::from(self.points.max(1)))
    }

    /// The variance of its samples, the components' mean.
    pub(crate) fn variance(&self) -> f64 {
        if self.points < 2 {
            return 0.0;
        }
        let n = f64::from(self.points);
        // Rounding may leave less than nothing.
        ((self.squares - self.sum.length_squared() / n) / (3.0 * (n - 1.0))).max(0.0)
    }

    /// What is thought of it by its neighbours' samples and its own: by their variance, and by the square of the contrast
    /// with which an edge seems to lie between it and a pixel beside it.
    pub(crate) fn expect(&mut self, variance: f64, step: f64) {
        (self.kappa, self.step) = (MODEL.edge * variance, step);
        self.weight = 3.0;
    }

    /// What is thought of it by what may hide in it: of too few samples to have a variance.
    pub(crate) fn expect_hidden(&mut self) {
        self.kappa = edge(self.doubt);
        self.weight = 3.0;
    }

    /// Its mean's expected squared error.
    pub(crate) fn error(&self) -> f64 {
        let n = f64::from(self.points.max(1));
        self.kappa / (n * n.sqrt()) + MODEL.beside.1 * self.step / (n * n)
    }

    /// How often its points are to be doubled next, 0 where it is done; as the mean of so large a part of a pixel.
    pub(crate) fn doublings(&self, rule: &Rule, area: f64) -> u32 {
        // Growth by g is worth it where κ is that of g times as many points, whose power is taken without a root.
        let (kappa, points) = (DOUBLING * self.kappa * area * area, f64::from(self.points.max(1)));
        let hidden = (MODEL.hidden * self.doubt * self.doubt).max(MODEL.beside.0 * self.step);
        let hidden = 0.75 * hidden * area * area;
        let worth = |growth: f64| {
            let n = growth * points;
            kappa > rule.a_point * n * n * n.sqrt() || hidden > rule.a_point * n * n * n
        };
        if self.next > MOST / 2 || !worth(MODEL.least_growth) {
            0
        } else if self.next > MOST / 4 || !worth(3.0) {
            1
        } else {
            2
        }
    }
}
