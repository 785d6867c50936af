//! Anchors and smart routing.

use super::chains::EdgeChains;
use super::detector::EdgeOptions;
use crate::image::GradientField;

/// State of a pixel during the routing.
const FREE: u8 = 0;
/// On a chain.
const EDGE: u8 = 1;
/// Removed from a chain as redundant; not used again.
const THINNED: u8 = 2;

/// Buffers of the routing.
#[derive(Debug, Clone, Default)]
pub(super) struct Router {
    state: Vec<u8>,
    anchors: Vec<u32>,
    sorted: Vec<u32>,
    /// Number of anchors per strength in decreasing order, then the first index of each strength.
    starts: Vec<u32>,
    chain: Vec<u32>,
    thinned: Vec<u32>,
}

impl Router {
    /// Replaces `chains` by the edges of a gradient field.
    pub(super) fn route(
        &mut self,
        field: &GradientField,
        options: &EdgeOptions,
        chains: &mut EdgeChains,
    ) {
        let (width, height) = (field.width(), field.height());
        chains.clear(width, height);
        self.state.clear();
        self.state.resize(width * height, FREE);
        self.find_anchors(field, options);
        self.sort_anchors(field);
        for position in 0..self.sorted.len() {
            let anchor = self.sorted[position];
            if self.state[anchor as usize] != FREE || self.fills_block(anchor as i32, width as i32)
            {
                continue;
            }
            self.draw(field, options, anchor);
            if self.chain.len() >= options.minimum_length_px.max(1) {
                chains.push(&self.chain);
            } else {
                for &index in self.chain.iter().chain(&self.thinned) {
                    self.state[index as usize] = FREE;
                }
            }
        }
    }

    /// Pixels whose strength exceeds that of both neighbours across the edge by the anchor threshold.
    fn find_anchors(&mut self, field: &GradientField, options: &EdgeOptions) {
        self.anchors.clear();
        let (width, height) = (field.width(), field.height());
        if width < 3 || height < 3 {
            return;
        }
        let least = options.gradient_threshold;
        let margin = options.anchor_threshold;
        for y in 1..height - 1 {
            let packed = field.packed();
            let above = &packed[(y - 1) * width..y * width];
            let row = &packed[y * width..(y + 1) * width];
            let below = &packed[(y + 1) * width..(y + 2) * width];
            let (above, below) = (&above[..row.len()], &below[..row.len()]);
            for x in 1..row.len() - 1 {
                let strength = row[x] >> 1;
                if strength < least {
                    continue;
                }
                let (one, other) = if row[x] & 1 == 1 {
                    (row[x - 1] >> 1, row[x + 1] >> 1)
                } else {
                    (above[x] >> 1, below[x] >> 1)
                };
                let exceeds_one = strength >= one.saturating_add(margin);
                let exceeds_other = strength >= other.saturating_add(margin);
                let index = y * width + x;
                let is_anchor = match (exceeds_one, exceeds_other) {
                    (true, true) => true,
                    (false, false) => false,
                    // The ridge may lie between two pixels of similar strength: the stronger one (the first of equal ones) is the
                    // anchor when the pair exceeds its other neighbour.
                    (true, false) => {
                        strength >= other
                            && pair_exceeds(packed, index, width, true, strength, margin)
                    }
                    (false, true) => {
                        strength > one
                            && pair_exceeds(packed, index, width, false, strength, margin)
                    }
                };
                if is_anchor {
                    self.anchors.push(index as u32);
                }
            }
        }
    }

    /// Stable counting sort by decreasing strength.
    fn sort_anchors(&mut self, field: &GradientField) {
        const STRONGEST: usize = 2040;
        let key =
            |index: u32| STRONGEST - usize::from(field.strength(index as usize)).min(STRONGEST);
        self.starts.clear();
        self.starts.resize(STRONGEST + 2, 0);
        for &anchor in &self.anchors {
            self.starts[key(anchor) + 1] += 1;
        }
        for i in 1..self.starts.len() {
            self.starts[i] += self.starts[i - 1];
        }
        self.sorted.clear();
        self.sorted.resize(self.anchors.len(), 0);
        for &anchor in &self.anchors {
            let slot = &mut self.starts[key(anchor)];
            self.sorted[*slot as usize] = anchor;
            *slot += 1;
        }
    }

    /// Traces the chain through an anchor into `self.chain`.
    fn draw(&mut self, field: &GradientField, options: &EdgeOptions, anchor: u32) {
        self.chain.clear();
        self.thinned.clear();
        self.chain.push(anchor);
        self.state[anchor as usize] = EDGE;
        let is_vertical = field.packed()[anchor as usize] & 1 == 1;
        let ahead = if is_vertical { (0, -1) } else { (-1, 0) };
        self.walk(field, options, ahead);
        self.chain.reverse();
        // Thinning may have replaced the anchor as the end of the chain.
        self.walk(field, options, (-ahead.0, -ahead.1));
    }

    /// Extends the chain from its last pixel until the edge ends; `step` is the direction to begin with.
    fn walk(&mut self, field: &GradientField, options: &EdgeOptions, mut step: (i32, i32)) {
        let packed = field.packed();
        let width = field.width() as i32;
        let Some(&last) = self.chain.last() else {
            return;
        };
        let mut current = last as i32;
        loop {
            let Some((next_step, next)) = step_ahead(packed, width, current, step) else {
                return;
            };
            if (packed[next as usize] >> 1) < options.gradient_threshold
                || self.state[next as usize] != FREE
            {
                return;
            }
            // A pixel whose two chain neighbours touch is redundant:      a b      a
            //                                                                     c  ->    c
            let mut taken = next_step;
            let mut superfluous = None;
            if let [.., before, corner] = self.chain[..] {
                let (dx, dy) = offset(before as i32, next, width);
                if dx.abs() <= 1 && dy.abs() <= 1 {
                    if let [.., earlier, _, _] = self.chain[..] {
                        let (dx, dy) = offset(earlier as i32, next, width);
                        if dx.abs() <= 1 && dy.abs() <= 1 {
                            // The walk folds back onto itself.
                            return;
                        }
                    }
                    self.state[corner as usize] = THINNED;
                    superfluous = Some(corner);
                    taken = (dx, dy);
                }
            }
            if self.fills_block(next, width) {
                if let Some(corner) = superfluous {
                    self.state[corner as usize] = EDGE;
                }
                return;
            }
            if let Some(corner) = superfluous {
                self.chain.pop();
                self.thinned.push(corner);
            }
            self.state[next as usize] = EDGE;
            self.chain.push(next as u32);
            current = next;
            step = taken;
        }
    }

    /// Whether a pixel, taken as an edge pixel, would complete a 2 x 2 block of them.
    fn fills_block(&self, index: i32, width: i32) -> bool {
        let on_edge = |offset: i32| self.state[(index + offset) as usize] == EDGE;
        let (left, right, up, down) = (on_edge(-1), on_edge(1), on_edge(-width), on_edge(width));
        (left && up && on_edge(-width - 1))
            || (right && up && on_edge(-width + 1))
            || (left && down && on_edge(width - 1))
            || (right && down && on_edge(width + 1))
    }
}

/// Whether a strength exceeds that of the second pixel across the edge by a margin; forwards is right or down.
fn pair_exceeds(
    packed: &[u16],
    index: usize,
    width: usize,
    is_forwards: bool,
    strength: u16,
    margin: u16,
) -> bool {
    let across = if packed[index] & 1 == 1 { 1 } else { width };
    let second = if is_forwards {
        index.checked_add(2 * across)
    } else {
        index.checked_sub(2 * across)
    };
    let second = second.and_then(|second| packed.get(second));
    second.is_some_and(|&second| strength >= (second >> 1).saturating_add(margin))
}

/// From one pixel to another that is at most two rows and columns away.
fn offset(from: i32, to: i32, width: i32) -> (i32, i32) {
    (to % width - from % width, to / width - from / width)
}

/// The strongest of the three pixels ahead, and the step to it.
///
/// On a vertical pixel, ahead means up or down, on a horizontal one left or right: the way of the last step or, when that
/// was straight across, the side with the strongest pixel. `None` on the image border. Ties go to the straight step, then
/// to the first in order of rows and columns.
fn step_ahead(
    packed: &[u16],
    width: i32,
    current: i32,
    step: (i32, i32),
) -> Option<((i32, i32), i32)> {
    let center = packed[current as usize];
    if center >> 1 == 0 {
        return None;
    }
    let is_vertical = center & 1 == 1;
    // Distance in samples along the edge and across it.
    let (along, across) = if is_vertical { (width, 1) } else { (1, width) };
    let strongest = |side: i32| {
        let base = current + side * along;
        let mut best = (packed[base as usize] >> 1, 0);
        for shift in [-1, 1] {
            let strength = packed[(base + shift * across) as usize] >> 1;
            if strength > best.0 {
                best = (strength, shift);
            }
        }
        best
    };
    let known_side = if is_vertical { step.1 } else { step.0 };
    let (side, shift) = if known_side != 0 {
        (known_side, strongest(known_side).1)
    } else {
        let (back, ahead) = (strongest(-1), strongest(1));
        if back.0 >= ahead.0 {
            (-1, back.1)
        } else {
            (1, ahead.1)
        }
    };
    let next = current + side * along + shift * across;
    let step = if is_vertical {
        (shift, side)
    } else {
        (side, shift)
    };
    Some((step, next))
}
