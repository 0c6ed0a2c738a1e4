//! What a factorisation needs to know before any value: elimination order, the pattern of the factor, and its supernodes,
//! called runs here: columns of nearly equal pattern that make one dense panel (Davis 2006, sections 4.1 to 4.8).

use super::CHUNK;
use crate::error::GraphError;

/// Blocks of a factor at most: 2 GB of the largest.
const LARGEST_FACTOR: usize = 7_000_000;
/// In place of no column.
pub(super) const NONE: usize = usize::MAX;

/// Which blocks of the lower triangle a matrix and its factor have; in every column the diagonal first, rows ascending.
#[derive(Debug, Clone)]
pub(crate) struct Pattern {
    pub(super) starts: Vec<usize>,
    pub(super) rows: Vec<usize>,
    /// For each block of the matrix its row's place among those of its run.
    pub(super) places: Vec<usize>,
    pub(super) runs: Vec<Run>,
    /// Rows of the runs: first its own columns, then those below.
    pub(super) run_rows: Vec<usize>,
    /// The run of each column.
    pub(super) run_of: Vec<usize>,
}

/// Columns of the factor that differ in pattern by little more than their own diagonals, kept as one dense panel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Run {
    /// Its first column.
    pub(super) first: usize,
    /// How many columns there are.
    pub(super) width: usize,
    /// Where its rows begin in `run_rows`.
    pub(super) rows: usize,
    /// How many rows there are.
    pub(super) height: usize,
    /// Blocks in the panels before this one.
    pub(super) area: usize,
}

impl Run {
    /// Where the panel begins; what follows on one may be read, not used.
    pub(super) fn start<const B: usize>(&self, at: usize) -> usize {
        self.area * B * B + at * CHUNK
    }
}

/// Where the block of two variables lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slot {
    pub(super) at: usize,
    /// Whether the block is that of (second, first).
    pub(super) transposed: bool,
}

impl Pattern {
    /// Of variables coupled by pairs, counted in elimination order, see [`elimination_order`].
    pub(crate) fn new(variables: usize, pairs: &[(usize, usize)]) -> Result<Self, GraphError> {
        let (starts, rows) = lower_pattern(variables, pairs, true);
        let (factor_starts, factor_rows) =
            factor_pattern(&starts, &rows).ok_or(GraphError::TooLarge { vertices: variables })?;
        let (runs, run_rows) = equal_runs(&factor_starts, &factor_rows);
        let (runs, run_rows) = merged_runs(&runs, &run_rows);
        let places = places_in_runs(&starts, &rows, &runs, &run_rows);
        let run_of = runs.iter().enumerate().flat_map(|(at, run)| std::iter::repeat_n(at, run.width)).collect();
        Ok(Self { starts, rows, places, runs, run_rows, run_of })
    }

    /// Where the block of a pair lies that the pattern was made with.
    pub(crate) fn slot(&self, first: usize, second: usize) -> Slot {
        let (column, row) = (first.min(second), first.max(second));
        let rows = &self.rows[self.starts[column]..self.starts[column + 1]];
        let place = rows.binary_search(&row).unwrap_or_default();
        Slot { at: self.starts[column] + place, transposed: first < second }
    }

    pub(super) fn variables(&self) -> usize {
        self.starts.len() - 1
    }

    /// The run that the first row below a run belongs to.
    pub(super) fn parent(&self, run: usize) -> Option<usize> {
        let first_below = self.rows_of(&self.runs[run]).get(self.runs[run].width)?;
        Some(self.run_of[*first_below])
    }

    pub(super) fn rows_of(&self, run: &Run) -> &[usize] {
        &self.run_rows[run.rows..run.rows + run.height]
    }

    /// Numbers in a factor, see [`Run::start`].
    pub(super) fn factor_len<const B: usize>(&self) -> usize {
        let area: usize = self.runs.iter().map(|run| run.width * run.height).sum();
        area * B * B + (self.runs.len() + 1) * CHUNK
    }
}

/// Approximate minimum degree (Amestoy, Davis, Duff 1996) over the graph of blocks: place of each variable.
pub(crate) fn elimination_order(variables: usize, pairs: &[(usize, usize)]) -> Result<Vec<usize>, GraphError> {
    // with the diagonal, for `amd` counts on at least as many blocks as variables
    let (starts, rows) = lower_pattern(variables, pairs, true);
    let ordered = amd::order(variables, &starts, &rows, &amd::Control::default());
    ordered.map(|(_, places, _)| places).map_err(|_| GraphError::TooLarge { vertices: variables })
}

/// Columns of the lower triangle, each sorted and without repetition.
fn lower_pattern(variables: usize, pairs: &[(usize, usize)], with_diagonal: bool) -> (Vec<usize>, Vec<usize>) {
    let mut starts = vec![0; variables + 2];
    let lower = || pairs.iter().filter(|(a, b)| a != b).map(|&(a, b)| (a.min(b), a.max(b)));
    let own = usize::from(with_diagonal);
    lower().for_each(|(column, _)| starts[column + 2] += 1);
    (0..variables).for_each(|column| starts[column + 2] += starts[column + 1] + own);
    let mut rows = vec![0; starts[variables + 1]];
    // `starts[column + 1]` moves from the column's beginning to its end
    (0..variables * own).for_each(|column| push(&mut rows, &mut starts[column + 1], column));
    lower().for_each(|(column, row)| push(&mut rows, &mut starts[column + 1], row));
    without_repetition(&mut starts, &mut rows);
    starts.pop();
    (starts, rows)
}

fn push(rows: &mut [usize], end: &mut usize, row: usize) {
    rows[*end] = row;
    *end += 1;
}

/// Sorts every column and drops what stands there twice.
fn without_repetition(starts: &mut [usize], rows: &mut Vec<usize>) {
    let (mut kept, mut begin) = (0, 0);
    for end in starts.iter_mut().skip(1) {
        let stop = (*end).min(rows.len());
        rows[begin.min(stop)..stop].sort_unstable();
        let first = kept;
        for at in begin..stop {
            if kept == first || rows[kept - 1] != rows[at] {
                rows[kept] = rows[at];
                kept += 1;
            }
        }
        begin = stop;
        *end = kept;
    }
    rows.truncate(kept);
}

/// The pattern of the factor; none where it is too large. Row by row, so that columns come out sorted: row `i` of the
/// factor is what the elimination tree reaches from row `i` of the matrix (Davis, section 4.2).
fn factor_pattern(starts: &[usize], rows: &[usize]) -> Option<(Vec<usize>, Vec<usize>)> {
    let variables = starts.len() - 1;
    let (row_starts, columns) = transposed(starts, rows);
    let parents = elimination_tree(&row_starts, &columns);
    let mut counts = vec![1_usize; variables];
    reach(&row_starts, &columns, &parents, |_, column| counts[column] += 1);
    let mut factor_starts = vec![0; variables + 1];
    (0..variables).for_each(|k| factor_starts[k + 1] = factor_starts[k] + counts[k]);
    if factor_starts[variables] > LARGEST_FACTOR {
        return None;
    }
    let mut factor_rows = vec![0; factor_starts[variables]];
    let mut ends = factor_starts[..variables].to_vec();
    (0..variables).for_each(|k| push(&mut factor_rows, &mut ends[k], k));
    reach(&row_starts, &columns, &parents, |row, column| push(&mut factor_rows, &mut ends[column], row));
    Some((factor_starts, factor_rows))
}

/// Parent of each column (Liu 1986), from the rows of the lower triangle.
fn elimination_tree(row_starts: &[usize], columns: &[usize]) -> Vec<usize> {
    let variables = row_starts.len() - 1;
    let (mut parents, mut ancestors) = (vec![NONE; variables], vec![NONE; variables]);
    for row in 0..variables {
        for &column in &columns[row_starts[row]..row_starts[row + 1]] {
            let mut at = column;
            while at != NONE && at < row {
                let next = std::mem::replace(&mut ancestors[at], row);
                if next == NONE {
                    parents[at] = row;
                }
                at = next;
            }
        }
    }
    parents
}

/// Visits every block (row, column) of the factor below the diagonal, rows ascending.
fn reach(row_starts: &[usize], columns: &[usize], parents: &[usize], mut visit: impl FnMut(usize, usize)) {
    let mut seen = vec![NONE; parents.len()];
    for row in 0..parents.len() {
        seen[row] = row;
        for &column in &columns[row_starts[row]..row_starts[row + 1]] {
            let mut at = column;
            while at != NONE && seen[at] != row {
                seen[at] = row;
                visit(row, at);
                at = parents[at];
            }
        }
    }
}

/// Runs and their rows.
fn equal_runs(factor_starts: &[usize], factor_rows: &[usize]) -> (Vec<Run>, Vec<usize>) {
    let (mut runs, mut run_rows, mut area): (Vec<Run>, Vec<usize>, usize) = (Vec::new(), Vec::new(), 0);
    for column in 0..factor_starts.len() - 1 {
        let rows = &factor_rows[factor_starts[column]..factor_starts[column + 1]];
        // columns nest: a parent has all rows of its child
        let continued = runs.last_mut().filter(|run| run.height - run.width == rows.len());
        match continued.filter(|run| run_rows.get(run.rows + run.width) == Some(&column)) {
            Some(run) => {
                run.width += 1;
                area += run.height;
            }
            None => {
                runs.push(Run { first: column, width: 1, rows: run_rows.len(), height: rows.len(), area });
                run_rows.extend_from_slice(rows);
                area += rows.len();
            }
        }
    }
    (runs, run_rows)
}

/// Widths up to which runs are merged, and what share of the blocks may then be zeros.
const MERGED: [(usize, f64); 3] = [(2, 0.5), (4, 0.2), (usize::MAX, 0.03)];

/// Runs that lead into the next one are merged with it where few zeros come of that: a wide panel is worth some.
fn merged_runs(runs: &[Run], run_rows: &[usize]) -> (Vec<Run>, Vec<usize>) {
    // the last run stands open; how many of its blocks are zeros
    let (mut merged, mut zeros): (Vec<Run>, usize) = (Vec::new(), 0);
    let mut last_rows = Vec::new();
    let (mut rows, mut area) = (Vec::new(), 0);
    for next in runs {
        let next_rows = &run_rows[next.rows..next.rows + next.height];
        if let Some(last) = merged.last_mut() {
            let more = last.width * (next.height + last.width).saturating_sub(last.height);
            let (width, height) = (last.width + next.width, last.width + next.height);
            let share = (zeros + more) as f64 / (width * height) as f64;
            let leads_there = last_rows.get(last.width) == Some(&next.first);
            if leads_there && MERGED.iter().any(|&(widest, most)| width <= widest && share <= most) {
                last_rows.truncate(last.width);
                last_rows.extend_from_slice(next_rows);
                (last.width, last.height, zeros) = (width, height, zeros + more);
                continue;
            }
            area += last.width * last.height;
            rows.append(&mut last_rows);
        }
        merged.push(Run { rows: rows.len(), area, ..*next });
        last_rows.extend_from_slice(next_rows);
        zeros = 0;
    }
    rows.append(&mut last_rows);
    (merged, rows)
}

fn places_in_runs(starts: &[usize], rows: &[usize], runs: &[Run], run_rows: &[usize]) -> Vec<usize> {
    let mut places = Vec::with_capacity(rows.len());
    for run in runs {
        let own = &run_rows[run.rows..run.rows + run.height];
        for column in run.first..run.first + run.width {
            let mut place = column - run.first;
            for row in &rows[starts[column]..starts[column + 1]] {
                while own[place] != *row {
                    place += 1;
                }
                places.push(place);
            }
        }
    }
    places
}

/// The pattern of the transposed matrix, its columns sorted.
fn transposed(starts: &[usize], rows: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let n = starts.len() - 1;
    let mut transposed_starts = vec![0; n + 1];
    rows.iter().for_each(|&row| transposed_starts[row + 1] += 1);
    (0..n).for_each(|k| transposed_starts[k + 1] += transposed_starts[k]);
    let mut next = transposed_starts.clone();
    let mut columns = vec![0; rows.len()];
    for column in 0..n {
        for &row in &rows[starts[column]..starts[column + 1]] {
            columns[next[row]] = column;
            next[row] += 1;
        }
    }
    (transposed_starts, columns)
}
