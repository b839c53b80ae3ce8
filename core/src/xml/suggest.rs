//! "Did you mean …?"

/// The one of `known` that `written` was probably meant to be.
pub(super) fn closest<'k>(written: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    if written.len() > 32 {
        return None;
    }
    let plain = |name: &str| name.to_lowercase().replace('-', "_");
    let lower = plain(written);
    known
        .into_iter()
        .filter_map(|k| {
            let distance = distance(&lower, &plain(k));
            (distance <= k.len().div_ceil(3).min(2) && distance < k.len()).then_some((distance, k))
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, k)| k)
}

/// Edits (insert, delete, replace, swap neighbours) that turn `a` into `b`.
fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut rows = vec![vec![0; b.len() + 1]; a.len() + 1];
    for i in 0..=a.len() {
        for j in 0..=b.len() {
            rows[i][j] = if i == 0 || j == 0 {
                i + j
            } else {
                let replace = rows[i - 1][j - 1] + usize::from(a[i - 1] != b[j - 1]);
                let best = replace.min(rows[i - 1][j] + 1).min(rows[i][j - 1] + 1);
                if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                    best.min(rows[i - 2][j - 2] + 1)
                } else {
                    best
                }
            };
        }
    }
    rows[a.len()][b.len()]
}

#[cfg(test)]
mod tests {
    use super::closest;

    #[test]
    fn suggests_near_names_only() {
        let known = ["sphere", "plane", "light", "triangle", "look_at", "x"];
        for (written, meant) in [
            ("shpere", "sphere"),
            ("Plane", "plane"),
            ("look-at", "look_at"),
            ("lookat", "look_at"),
            ("traingle", "triangle"),
            ("X", "x"),
        ] {
            assert_eq!(closest(written, known), Some(meant), "{written}");
        }
        for written in ["cube", "y", "", "mesh", "light_source"] {
            assert_eq!(closest(written, known), None, "{written}");
        }
    }
}
