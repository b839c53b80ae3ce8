//! Numbers in rows, as vectors read them.

/// The most numbers of a row.
pub(crate) const MOST: usize = 8;

/// `N` rows of `count` numbers each, one behind the other.
#[derive(Clone, Copy)]
pub(crate) struct Rows<'a, const N: usize> {
    /// `N` · [`MOST`] numbers, of which the rows are the first.
    numbers: &'a [f32],
    count: usize,
}

impl<'a, const N: usize> Rows<'a, N> {
    /// The rows that `numbers` begins with.
    ///
    /// # Panics
    /// Where there is no room for rows of [`MOST`], or they have more or no numbers.
    #[inline(always)]
    pub(crate) fn new(numbers: &'a [f32], count: usize) -> Self {
        assert!((1..=MOST).contains(&count));
        Self { numbers: &numbers[..N * MOST], count }
    }

    /// Row `k`, and what is behind it.
    #[inline(always)]
    pub(crate) fn row(&self, k: usize) -> &'a [f32; MOST] {
        assert!(k < N);
        // Checked one by one, rows would take as long as the arithmetic with them.
        // SAFETY: k < N and count ≤ MOST, so that k · count + MOST ≤ N · MOST, and there are so many.
        unsafe { &*self.numbers.as_ptr().add(k * self.count).cast() }
    }

    /// All rows, at places that do not depend on how long they are.
    #[inline(always)]
    pub(crate) fn spread(&self) -> [[f32; MOST]; N] {
        let mut spread = [[0.0; MOST]; N];
        for k in 0..N {
            spread[k] = *self.row(k);
        }
        spread
    }

    /// The `i`-th number of row `k`.
    #[inline(always)]
    pub(crate) fn at(&self, k: usize, i: usize) -> f32 {
        self.numbers[k * self.count + i]
    }
}
