//! Keyframes that may show the same place as an image.

use linecarve_points::Descriptor;
use serde::{Deserialize, Serialize};

use crate::map::KeyframeId;

/// Bits of a word.
const WORD_BITS: u32 = 16;

/// Number of tables, each with other bits. ORB's tests are ordered by their independence, so the first ones are used.
const TABLES: usize = 4;

/// An inverted index from words to keyframes. The word of a descriptor is a fixed part of its bits, so that no vocabulary is
/// needed.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Places {
    /// Keyframes of each word of each table, ascending, once per feature.
    lists: Vec<Vec<KeyframeId>>,
    keyframes: usize,
}

impl Default for Places {
    fn default() -> Self {
        Self {
            lists: vec![Vec::new(); TABLES << WORD_BITS],
            keyframes: 0,
        }
    }
}

/// Positions in the lists of the words of a descriptor.
fn words(descriptor: &Descriptor) -> [usize; TABLES] {
    [0, 1, 2, 3].map(|table| {
        let word = (descriptor.0[0] >> (table as u32 * WORD_BITS)) & ((1 << WORD_BITS) - 1);
        (table << WORD_BITS) + word as usize
    })
}

impl Places {
    /// Adds a keyframe; keyframes come in ascending order.
    pub(crate) fn add(&mut self, keyframe: KeyframeId, descriptors: &[Descriptor]) {
        self.keyframes += 1;
        for descriptor in descriptors {
            for word in words(descriptor) {
                let list = &mut self.lists[word];
                if list.last() != Some(&keyframe) {
                    list.push(keyframe);
                }
            }
        }
    }

    /// Keyframes by similarity, most similar first: the sum, over common words, of the logarithm of their rarity.
    pub(crate) fn query(&self, descriptors: &[Descriptor], total: usize) -> Vec<(KeyframeId, f64)> {
        let mut scores = vec![0.0_f64; total];
        for descriptor in descriptors {
            for word in words(descriptor) {
                let list = &self.lists[word];
                if list.is_empty() {
                    continue;
                }
                let weight = (1.0 + self.keyframes as f64 / list.len() as f64).ln();
                for keyframe in list {
                    scores[keyframe.index()] += weight;
                }
            }
        }
        let mut found: Vec<(KeyframeId, f64)> = scores
            .into_iter()
            .enumerate()
            .filter(|(_, score)| *score > 0.0)
            .map(|(index, score)| (KeyframeId(index as u32), score))
            .collect();
        found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn the_same_place_scores_highest() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let scenes: Vec<Vec<Descriptor>> = (0..20)
            .map(|_| {
                (0..500)
                    .map(|_| Descriptor([(); 4].map(|()| random.random())))
                    .collect()
            })
            .collect();
        let mut places = Places::default();
        for (index, scene) in scenes.iter().enumerate() {
            places.add(KeyframeId(index as u32), scene);
        }
        // Half of the features are seen again, each bit wrong with a probability of 8 %.
        let again: Vec<Descriptor> = scenes[13][..250]
            .iter()
            .map(|descriptor| {
                let noise = |bits: u64, random: &mut rand_chacha::ChaCha8Rng| {
                    (0..64).fold(bits, |bits, bit| {
                        bits ^ (u64::from(random.random_range(0.0..1.0) < 0.08) << bit)
                    })
                };
                Descriptor(descriptor.0.map(|bits| noise(bits, &mut random)))
            })
            .collect();
        let found = places.query(&again, 20);
        assert_eq!(found[0].0, KeyframeId(13));
        assert!(found.len() == 1 || found[0].1 > 5.0 * found[1].1);
    }
}
