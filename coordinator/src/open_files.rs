//! How many files this process may have open: each connection is one.

/// Takes as many as the system lets this process have, up to 65,536.
pub fn raise() {
    #[cfg(unix)]
    {
        use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
        let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
        let wanted = maximum.unwrap_or(u64::MAX).min(1 << 16);
        if current.is_some_and(|now| now < wanted) {
            // Where it is not granted, there is room for fewer.
            let _ = setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), maximum });
        }
    }
}

/// Files that this process may have open.
#[cfg(unix)]
pub(crate) fn limit() -> usize {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Nofile).current;
    limit.map_or(usize::MAX, |n| usize::try_from(n).unwrap_or(usize::MAX))
}

#[cfg(not(unix))]
pub(crate) fn limit() -> usize {
    1024
}
