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
            let distance = strsim::osa_distance(&lower, &plain(k));
            (distance <= k.len().div_ceil(3).min(2) && distance < k.len()).then_some((distance, k))
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, k)| k)
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
