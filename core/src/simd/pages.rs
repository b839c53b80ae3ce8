//! Memory in large pages.

/// From so many bytes on, large pages are worth asking for.
const LARGE: usize = 4 << 20;

/// An empty vector with room for `count`, if there is that much memory. Of fresh memory, every
/// page takes the system longer to hand out than a thread to fill; so it is asked for large ones.
pub(crate) fn roomy<T>(count: usize) -> Vec<T> {
    let mut roomy = Vec::new();
    if roomy.try_reserve_exact(count).is_ok() && count.saturating_mul(size_of::<T>()) >= LARGE {
        #[cfg(target_os = "linux")]
        advise(roomy.spare_capacity_mut());
    }
    roomy
}

#[cfg(target_os = "linux")]
fn advise<T>(room: &mut [std::mem::MaybeUninit<T>]) {
    const PAGE: usize = 4096;
    let bytes = size_of_val(room);
    let start = room.as_mut_ptr().cast::<libc::c_void>();
    let skipped = start.addr().next_multiple_of(PAGE) - start.addr();
    let whole = bytes.saturating_sub(skipped) / PAGE * PAGE;
    // SAFETY: these pages are the slice's alone, and the advice changes nothing in them. Where the
    // system does not take it, nothing is lost.
    unsafe { libc::madvise(start.wrapping_byte_add(skipped), whole, libc::MADV_HUGEPAGE) };
}
