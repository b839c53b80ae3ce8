//! Rows as columns.

use comfy_table::{CellAlignment, Table, presets};

/// Each column as wide as its widest cell, two spaces before the next; those of `right` end together rather than begin.
/// A row without cells is an empty line.
#[must_use]
pub fn columns(rows: &[Vec<String>], right: &[usize]) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).add_rows(rows);
    for (i, column) in table.column_iter_mut().enumerate() {
        column.set_padding((0, 2));
        if right.contains(&i) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.lines().map(|line| line.trim_end().to_owned() + "\n").collect()
}

#[cfg(test)]
mod tests {
    use super::columns;

    #[test]
    fn columns_are_straight_in_any_script() {
        let rows = [["ID", "NAME", "N"], ["1", "日本", "7"], ["10", "x", "123"]];
        let rows: Vec<Vec<String>> = rows.iter().map(|r| r.map(String::from).to_vec()).collect();
        assert_eq!(columns(&[rows[1].clone(), Vec::new(), rows[2].clone()], &[]), "1   日本  7\n\n10  x     123\n");
        assert_eq!(columns(&rows, &[2]), "ID  NAME    N\n1   日本    7\n10  x     123\n");
    }
}
