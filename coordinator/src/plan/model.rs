//! What the plan assumes of errors and costs, in one place.
//!
//! *Fitted* values are measured anew by `cargo xtask calibrate`. *Chosen* ones say what is wanted, or how careful to
//! be. The sampler's own model, which says what a tolerance means, is `Tolerance::MODEL`.

use tessera_core::settings::AuditRate;

/// Constants of the plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model {
    /// Points that pixels begin with. Fitted: one where that is proven to be enough, else up to four.
    pub first_points: f64,
    /// A picture of at most so many pixels is audited as a whole. Chosen: that is as many as are audited of any
    /// other.
    pub small: u64,
    /// Pixels audited where a picture has many. Chosen: so that the interval is narrow
    /// enough to aim close below the target.
    pub audited: f64,
    /// And those of smaller ones, which may cost more than their share. Chosen: with fewer, the interval is so wide
    /// that the picture has to be far better than was asked for.
    pub audited_at_least: f64,
    /// Audits draw no more than this rate, but for [`Self::audited_at_least`]. Chosen: an audit at a rate costs
    /// [`Self::audit_cost`] times that, so that audits take a twentieth of the picture's points.
    pub most_rate: f64,
    /// Points beyond the first rise with the inverse of the tolerance to this power. Follows from the sampler's
    /// model, in which a typical edge gets κ/t² to ⅔ of them.
    pub points_power: f64,
    /// What an audit costs, as a share of the picture's points, for a rate of 1, where few pixels are sure to be
    /// drawn. Fitted: two sets of as many points each, of pixels with more points than most. Only a reason for
    /// [`Self::most_rate`].
    pub audit_cost: f64,
    /// Of all pixels, how many an audit draws for a rate of 1. Fitted; only where nothing was drawn yet.
    pub drawn: f64,
    /// Pixels audited of a coarse picture. Chosen: what it errs by is not known better than to a tenth, and need not
    /// be.
    pub coarse_audited: f64,

    /// Blocks of 8 × 8 pixels that the first look sees, and those that follow where it saw what was not expected; and
    /// of large pictures one block in so many at least. Chosen: a look costs some hundredths of the render.
    pub looks: [(f64, f64); 2],
    /// The rate of looks' audits. Chosen: one in five of the pixels that are not proven, and more of those that are
    /// expected to err most.
    pub look_rate: AuditRate,
    /// What a look costs, in renders of as many pixels. Fitted: its audit.
    pub audited_look: f64,

    /// The first tolerance that is tried, in errors asked for. Fitted: ordinary pictures err by so much less than the
    /// tolerance, one pixel in a dozen being on an edge.
    pub guess: f64,
    /// No tolerance is above this. Fitted: no pixel gets more than its first points there.
    pub loosest: f64,
    /// Errors fall with the tolerance to about this power. Fitted.
    pub error_power: f64,
    /// What the sampler expects may be off by this share, as far as is known before anything is audited. Fitted: the
    /// root mean square of the logarithm of true to expected errors.
    pub expected_off: f64,
    /// After a look that saw what was expected, errors are changed by such factors at most without another look.
    /// Chosen: over more, [`Self::error_power`] would carry what it is off by.
    pub near: [f64; 2],
    /// Errors are changed by such factors at a time. Chosen: nothing is known of what lies further off.
    pub steps: [f64; 2],

    /// The error is aimed at this share of the target at most. Fitted: what pictures come to when they aim at it lies
    /// below the target, and the upper end of the interval too.
    pub most_aim: f64,
    /// The upper end of the interval is aimed at this share of the target. Chosen: what is missed costs another
    /// render.
    pub sure: f64,
    /// The error itself is aimed at this share of the target at least, however wide the interval. Chosen: below it,
    /// rendering again costs less than being so careful.
    pub least_aim: f64,
    /// And at this one of a small picture, which is searched as a whole. Chosen in the same way.
    pub least_aim_at_all: f64,
    /// What a look at parts saw counts as what was expected there times such factors at most. Chosen: a pixel that
    /// errs by far more than was thought says that something is missed, and not how the error depends on the
    /// tolerance.
    pub surprise: [f64; 2],
    /// A render's interval narrows to this share of a look's at most. Chosen: an audit of more pixels is more exact,
    /// but for what few of them have most of.
    pub narrows: f64,
    /// After a render that missed the target, this share of it is aimed at, by this much finer at least. Chosen.
    pub once_more: f64,
    /// Where only the interval's width missed the target, so many times as much is audited. Chosen: it halves the
    /// width.
    pub closer: u32,
    /// A tolerance has helped where the error fell by this share of what the tolerance did. Chosen: with less,
    /// tolerances cost more than errors fall.
    pub helps: f64,
    /// A picture that is better than this share of the target is too good. Chosen: time went into what nobody asked
    /// for.
    pub too_good: f64,

    /// Pixels along the squares of the first picture under a time limit. Chosen: it takes a sixty-fourth of the time
    /// of one point a pixel, and what is where can be seen.
    pub coarse_step: u32,
    /// The tolerance of the first picture there that is not coarse. Chosen: an ordinary picture is a draft then.
    pub timed_tolerance: f64,
    /// Points a pixel of that, with its audit and the pixels around tiles. Fitted.
    pub timed_points: f64,
    /// The share of the time left that the next pass is to take. Chosen: what is not complete in time is lost.
    pub share: f64,
    /// Time rises with the inverse of the tolerance to about this power. Fitted.
    pub time_power: f64,
}

/// The constants as they are.
pub const MODEL: Model = Model {
    first_points: 2.0,
    small: 3000,
    audited: 3000.0,
    audited_at_least: 500.0,
    most_rate: 0.04,
    points_power: 4.0 / 3.0,
    audit_cost: 1.3,
    drawn: 0.3,
    coarse_audited: 256.0,
    looks: [(100.0, 200.0), (150.0, 100.0)],
    look_rate: AuditRate((2 << 16) / 5),
    audited_look: 1.45,
    guess: 4.0,
    loosest: 64.0 / 255.0,
    error_power: 0.9,
    expected_off: 0.2,
    near: [0.4, 2.5],
    steps: [0.1, 4.0],
    most_aim: 0.82,
    sure: 0.9,
    least_aim: 0.55,
    least_aim_at_all: 0.45,
    surprise: [0.6, 1.5],
    narrows: 0.8,
    once_more: 0.9,
    closer: 4,
    helps: 0.3,
    too_good: 0.4,
    coarse_step: 8,
    timed_tolerance: 8.0 / 255.0,
    timed_points: 6.0,
    share: 0.4,
    time_power: 0.9,
};
