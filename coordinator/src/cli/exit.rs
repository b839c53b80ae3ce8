//! How the program ends.

use std::process::ExitCode;

use coordinator::RenderError;

/// What the exit code says; scripts rely on the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Exit {
    /// Everything asked for was done.
    Done = 0,
    /// The render failed; pictures differ by more than is tolerated.
    Failed = 1,
    /// The arguments cannot be followed.
    Usage = 2,
    /// The scene is not valid.
    Scene = 3,
    /// No worker came, or all were lost for good.
    NoWorkers = 4,
    /// The accuracy asked for was not reached, for want of time or otherwise; the picture is written.
    TargetMissed = 5,
    /// Stopped by a signal.
    Interrupted = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// An end with something to say.
#[derive(Debug)]
pub(crate) struct Failure {
    /// What goes to stderr, without "error:".
    pub(crate) message: String,
    /// The code.
    pub(crate) exit: Exit,
}

impl Failure {
    /// Ends with `exit`, saying `message`.
    pub(crate) fn new(exit: Exit, message: impl ToString) -> Self {
        Self { message: message.to_string(), exit }
    }

    /// Ends with [`Exit::Usage`].
    pub(crate) fn usage(message: impl ToString) -> Self {
        Self::new(Exit::Usage, message)
    }
}

impl From<&RenderError> for Failure {
    fn from(error: &RenderError) -> Self {
        let exit = match error {
            RenderError::NoWorkers { .. } => Exit::NoWorkers,
            RenderError::Prepare(_) | RenderError::Region(_) => Exit::Usage,
            RenderError::Cancelled => return Self::new(Exit::Interrupted, "interrupted"),
            RenderError::Listen { .. }
            | RenderError::Tile { .. }
            | RenderError::Memory(_)
            | RenderError::Scratch(..)
            | RenderError::Journal(_)
            | RenderError::Internal(_) => Exit::Failed,
        };
        let remedy = match error {
            RenderError::NoWorkers { ever: false, .. } => {
                "; start workers by 'worker --connect HOST:PORT', or let this machine help with --workers N"
            }
            _ => "",
        };
        Self::new(exit, format!("{error}{remedy}"))
    }
}
