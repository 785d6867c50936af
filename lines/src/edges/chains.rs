//! Edge chains in flat arrays, with a check of their invariants.

use thiserror::Error;

use crate::image::GradientField;

/// The edges of one image as pixel chains.
///
/// Guarantees, verified by [`EdgeChains::check`]: consecutive pixels of a chain are 8-neighbours; each pixel belongs to at most one chain,
/// once; chains are one pixel wide (no pixel is redundant, and no 2 x 2 block consists of edge pixels only).
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeChains {
    width: usize,
    height: usize,
    /// Chain `i` has the pixels `offsets[i]..offsets[i + 1]`; one more entry than chains.
    offsets: Vec<u32>,
    pixels: Vec<[u16; 2]>,
    /// Sub-pixel position of the gradient maximum in each pixel.
    positions: Vec<[f32; 2]>,
}

/// A violated invariant of [`EdgeChains`] with its witness.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ChainViolation {
    /// A pixel lies outside the image.
    #[error("chain {chain} leaves the image at pixel {pixel:?}")]
    Outside {
        /// Chain index.
        chain: usize,
        /// The pixel.
        pixel: [u16; 2],
    },
    /// Two consecutive pixels do not touch.
    #[error("chain {chain} has a gap after position {position}")]
    Gap {
        /// Chain index.
        chain: usize,
        /// Position of the pixel before the gap.
        position: usize,
    },
    /// A pixel is visited twice.
    #[error("pixel {pixel:?} lies on chain {first} and again on chain {second}")]
    Shared {
        /// The pixel.
        pixel: [u16; 2],
        /// The chain that has it first.
        first: usize,
        /// The chain that has it again.
        second: usize,
    },
    /// The two chain neighbours of a pixel touch each other, so that the pixel is redundant.
    #[error("chain {chain} has a redundant pixel at position {position}")]
    Corner {
        /// Chain index.
        chain: usize,
        /// Position of the redundant pixel.
        position: usize,
    },
    /// All pixels of a 2 x 2 block are edge pixels.
    #[error("the 2 x 2 block at {pixel:?} is filled with edge pixels")]
    Block {
        /// Top-left pixel of the block.
        pixel: [u16; 2],
    },
}

impl Default for EdgeChains {
    fn default() -> Self {
        Self::new(0, 0)
    }
}

impl EdgeChains {
    /// Empty chains for an image of the given size.
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            offsets: vec![0],
            pixels: Vec::new(),
            positions: Vec::new(),
        }
    }

    /// Width of the image in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height of the image in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Number of chains.
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Whether there is no chain.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The pixels (x, y) of one chain in order.
    ///
    /// # Panics
    /// When the chain does not exist.
    pub fn chain(&self, index: usize) -> &[[u16; 2]] {
        &self.pixels[self.offsets[index] as usize..self.offsets[index + 1] as usize]
    }

    /// Index of the first pixel of a chain in [`EdgeChains::pixels`].
    ///
    /// # Panics
    /// When the chain does not exist.
    pub fn start(&self, index: usize) -> usize {
        self.offsets[index] as usize
    }

    /// All chains in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[[u16; 2]]> {
        self.offsets
            .windows(2)
            .map(|range| &self.pixels[range[0] as usize..range[1] as usize])
    }

    /// The pixels of all chains, one chain after the other.
    pub fn pixels(&self) -> &[[u16; 2]] {
        &self.pixels
    }

    /// Sub-pixel positions (x, y) of the pixels of all chains: the gradient maximum across the edge, at most half a pixel from the pixel
    /// centre.
    pub fn positions(&self) -> &[[f32; 2]] {
        &self.positions
    }

    /// Removes all chains and sets the image size, keeping the memory.
    pub(super) fn clear(&mut self, width: usize, height: usize) {
        self.width = width;
        self.height = height;
        self.offsets.clear();
        self.offsets.push(0);
        self.pixels.clear();
        self.positions.clear();
    }

    /// Appends a chain of pixels given by row-major indices, with the pixel centres as positions.
    ///
    /// The caller keeps the guarantees; [`EdgeChains::check`] verifies them.
    pub fn push(&mut self, indices: &[u32]) {
        let width = self.width as u32;
        self.pixels.extend(
            indices
                .iter()
                .map(|&index| [(index % width) as u16, (index / width) as u16]),
        );
        let added = &self.pixels[self.positions.len()..];
        self.positions
            .extend(added.iter().map(|p| p.map(f32::from)));
        self.offsets.push(self.pixels.len() as u32);
    }

    /// Appends a chain with known positions.
    #[cfg(test)]
    pub(crate) fn push_at(&mut self, indices: &[u32], positions: &[[f32; 2]]) {
        self.push(indices);
        let start = self.positions.len() - positions.len();
        self.positions[start..].copy_from_slice(positions);
    }

    /// Moves each position to the gradient maximum: the vertex of the parabola through the strengths of the pixel and its two neighbours
    /// across the edge.
    ///
    /// Pixel centres are too coarse for line fitting: on an edge nearly parallel to the pixel rows, a whole window of pixels lies in one
    /// row and has the direction of the row, not of the edge.
    pub(super) fn refine(&mut self, field: &GradientField) {
        let packed = field.packed();
        let width = self.width;
        for (position, &[x, y]) in self.positions.iter_mut().zip(&self.pixels) {
            let index = usize::from(y) * width + usize::from(x);
            let is_vertical = packed[index] & 1 == 1;
            let across = if is_vertical { 1 } else { width };
            let strength = |index: usize| f32::from(packed[index] >> 1);
            // Chain pixels never lie on the image border.
            let (before, center, after) = (
                strength(index - across),
                strength(index),
                strength(index + across),
            );
            let curvature = before - 2.0 * center + after;
            let shift = if curvature < 0.0 {
                (0.5 * (before - after) / curvature).clamp(-0.5, 0.5)
            } else {
                0.0
            };
            position[usize::from(!is_vertical)] += shift;
        }
    }

    /// Verifies every guarantee.
    ///
    /// # Errors
    /// The first violation with its witness.
    pub fn check(&self) -> Result<(), ChainViolation> {
        let mut owner: Vec<Option<u32>> = vec![None; self.width * self.height];
        for (index, chain) in self.iter().enumerate() {
            for (position, &pixel) in chain.iter().enumerate() {
                let (x, y) = (usize::from(pixel[0]), usize::from(pixel[1]));
                if x >= self.width || y >= self.height {
                    return Err(ChainViolation::Outside {
                        chain: index,
                        pixel,
                    });
                }
                if let Some(first) = owner[y * self.width + x].replace(index as u32) {
                    let first = first as usize;
                    return Err(ChainViolation::Shared {
                        pixel,
                        first,
                        second: index,
                    });
                }
                if position + 1 < chain.len() && !touch(pixel, chain[position + 1]) {
                    return Err(ChainViolation::Gap {
                        chain: index,
                        position,
                    });
                }
                if position > 0
                    && position + 1 < chain.len()
                    && touch(chain[position - 1], chain[position + 1])
                {
                    return Err(ChainViolation::Corner {
                        chain: index,
                        position,
                    });
                }
            }
        }
        for &[x, y] in &self.pixels {
            let on_edge = |x: usize, y: usize| {
                x < self.width && y < self.height && owner[y * self.width + x].is_some()
            };
            let (left, top) = (usize::from(x), usize::from(y));
            if on_edge(left + 1, top) && on_edge(left, top + 1) && on_edge(left + 1, top + 1) {
                return Err(ChainViolation::Block { pixel: [x, y] });
            }
        }
        Ok(())
    }
}

/// Whether two different pixels are 8-neighbours (a pixel does not touch itself).
fn touch(a: [u16; 2], b: [u16; 2]) -> bool {
    a != b && a[0].abs_diff(b[0]) <= 1 && a[1].abs_diff(b[1]) <= 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chains(all: &[&[[u16; 2]]]) -> EdgeChains {
        let mut chains = EdgeChains::new(8, 8);
        for chain in all {
            let indices: Vec<u32> = chain
                .iter()
                .map(|p| u32::from(p[1]) * 8 + u32::from(p[0]))
                .collect();
            chains.push(&indices);
        }
        chains
    }

    #[test]
    fn good_chains_pass() {
        let good = chains(&[&[[0, 0], [1, 1], [2, 1]], &[[5, 5]]]);
        assert_eq!(good.check(), Ok(()));
        assert_eq!(good.len(), 2);
        assert_eq!(good.chain(1), &[[5, 5]]);
        assert_eq!(good.start(1), 3);
    }

    #[test]
    fn each_violation_has_its_witness() {
        let gap = chains(&[&[[0, 0], [2, 0]]]);
        assert_eq!(
            gap.check(),
            Err(ChainViolation::Gap {
                chain: 0,
                position: 0
            })
        );
        let shared = chains(&[&[[0, 0], [1, 1]], &[[2, 0], [1, 1]]]);
        assert!(matches!(
            shared.check(),
            Err(ChainViolation::Shared { pixel: [1, 1], .. })
        ));
        let corner = chains(&[&[[0, 0], [1, 0], [1, 1]]]);
        assert_eq!(
            corner.check(),
            Err(ChainViolation::Corner {
                chain: 0,
                position: 1
            })
        );
        let block = chains(&[&[[0, 0], [1, 0]], &[[0, 1], [1, 1]]]);
        assert_eq!(block.check(), Err(ChainViolation::Block { pixel: [0, 0] }));
        let outside = EdgeChains {
            width: 2,
            height: 2,
            offsets: vec![0, 1],
            pixels: vec![[2, 0]],
            positions: vec![[2.0, 0.0]],
        };
        assert!(matches!(
            outside.check(),
            Err(ChainViolation::Outside { .. })
        ));
    }
}
