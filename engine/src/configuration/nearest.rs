//! The key that was probably meant.

use super::Configuration;

/// The key nearest to `path`: by its own name first, so that a key in the wrong table is found, then by the whole path.
/// `None` when no name is similar.
pub(super) fn nearest(path: &str) -> Option<&'static str> {
    let name = last(path);
    let (distance, _, key) = Configuration::tables()
        .iter()
        .flat_map(|table| table.keys)
        .map(|key| {
            let of_names = edit_distance(name, last(key.path));
            (of_names, edit_distance(path, key.path), key.path)
        })
        .min()?;
    let longest_slip = (name.chars().count() / 3).max(2);
    (distance <= longest_slip).then_some(key)
}

/// The keys of the table that `path` belongs to; none when there is no such table.
pub(super) fn siblings(path: &str) -> Vec<&'static str> {
    let table = path.rsplit_once('.').map_or("", |(table, _)| table);
    Configuration::tables()
        .iter()
        .filter(|known| known.name == table)
        .flat_map(|table| table.keys)
        .map(|key| last(key.path))
        .collect()
}

fn last(path: &str) -> &str {
    path.rsplit_once('.').map_or(path, |(_, name)| name)
}

/// Least number of characters to insert, delete or replace (Levenshtein 1966).
///
/// # Complexity
/// O(|a| |b|).
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_edits() {
        for (a, b, distance) in [
            ("", "", 0),
            ("", "abc", 3),
            ("labels", "labels", 0),
            ("label", "labels", 1),
            ("kitten", "sitting", 3),
            ("ab", "ba", 2),
        ] {
            assert_eq!(edit_distance(a, b), distance, "{a} {b}");
            assert_eq!(edit_distance(b, a), distance, "{b} {a}");
        }
    }

    #[test]
    fn slips_and_wrong_tables_are_found_and_other_words_are_not() {
        for (path, key) in [
            ("carving.label", Some("carving.labels")),
            ("carvng.labels", Some("carving.labels")),
            ("surface.free_threshold", Some("carving.free_threshold")),
            ("min_views", Some("map_points.min_views")),
            ("images.longest_side", Some("images.longest_side_px")),
            ("simplify.tolerence", Some("simplify.tolerance")),
            ("carving.voxel_size", None),
        ] {
            assert_eq!(nearest(path), key, "{path}");
        }
        assert_eq!(siblings("sensor.bias"), ["relative_noise"]);
    }
}
