//! In which maps the words of a map stand, and what they say of the transforms between the maps.

use crate::local_map::LocalMap;
use crate::parallel;
use crate::se2::{wrap, Se2, Vec2};
use rustc_hash::FxHashMap;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Most marks of a map, corners first.
const MAX_MARKS: usize = 160;
/// Least and largest distance between the marks of a word, metres.
const SPAN: (f64, f64) = (0.8, 8.0);
/// Side of the squares that positions are told apart by, metres; those next to a position are looked up as well.
const CELL: f64 = 0.3;
/// Number of directions that headings are told apart by.
const HEADINGS: f64 = 16.0;
/// Side of the squares in which votes for one shift are counted, metres.
const VOTE_CELL: f64 = 1.2;
/// Number of rotations in which votes are counted.
const VOTE_TURNS: f64 = 36.0;
/// Most transforms of a map that are looked at, those with the most votes first.
const MAX_LOOKS: usize = 300;
/// Words that stand in more than this share of the maps tell nothing; never fewer than [`LEAST_COMMON`].
const COMMON: f64 = 0.3;
/// Words that stand this many times are looked up in any case.
const LEAST_COMMON: usize = 64;

/// A place that tells itself from its surroundings, with a direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    at: Vec2,
    heading: f64,
    /// Inner corner, outer corner, or either end of a wall.
    kind: u64,
}

/// Two marks of one map: the middle between them and the direction from the first to the second, as an angle and as a
/// unit vector.
#[derive(Debug, Clone, Copy)]
struct Word {
    key: u64,
    map: u32,
    middle: [f32; 2],
    direction: f32,
    along: [f32; 2],
}

/// Of a map, at most [`MAX_MARKS`].
pub(super) fn marks(map: &LocalMap) -> Vec<Mark> {
    let corners = map.corners.iter().map(|c| {
        let b = c.bisector();
        Mark { at: c.vertex, heading: b.y.atan2(b.x), kind: u64::from(c.opening > PI) }
    });
    let ends = map.lines.iter().flat_map(|l| {
        let heading = l.normal.y.atan2(l.normal.x);
        [Mark { at: l.start, heading, kind: 2 }, Mark { at: l.end, heading, kind: 3 }]
    });
    let mut found: Vec<Mark> = corners.collect();
    for end in ends {
        // The end of a wall at a corner is the corner.
        if !found.iter().any(|m| m.kind < 2 && (m.at - end.at).norm() < CELL) {
            found.push(end);
        }
    }
    found.truncate(MAX_MARKS);
    found
}

/// The second mark as seen from the first: position in cells, heading in steps.
fn seen_from(a: &Mark, b: &Mark) -> Option<(f64, f64, f64)> {
    let d = b.at - a.at;
    let distance = d.norm();
    if distance < SPAN.0 || distance > SPAN.1 {
        return None;
    }
    let along = d.y.atan2(d.x) - a.heading;
    let turn = (b.heading - a.heading).rem_euclid(TAU) * HEADINGS / TAU;
    Some((distance * along.cos() / CELL, distance * along.sin() / CELL, turn))
}

fn key(kinds: (u64, u64), u: i64, v: i64, turn: i64) -> u64 {
    let turn = turn.rem_euclid(HEADINGS as i64) as u64;
    ((kinds.0 * 4 + kinds.1) << 40) | (turn << 32) | (((u + 128) as u64) << 16) | (v + 128) as u64
}

/// Pairs of marks of a map; `each` gets where the second lies as seen from the first, the middle between them and the
/// way from the first to the second.
fn each_word(marks: &[Mark], mut each: impl FnMut((u64, u64), (f64, f64, f64), (Vec2, Vec2))) {
    for a in marks {
        // The first mark is never of the later kind: one of two words that say the same is enough.
        for b in marks.iter().filter(|b| b.kind >= a.kind) {
            if let Some(seen) = seen_from(a, b) {
                each((a.kind, b.kind), seen, (0.5 * (a.at + b.at), b.at - a.at));
            }
        }
    }
}

/// Where the words stand.
pub(super) struct Index {
    /// In the order of their keys, then of the maps.
    words: Vec<Word>,
    /// Where each key begins and ends.
    at: FxHashMap<u64, (u32, u32)>,
    most: usize,
    maps: f64,
}

impl Index {
    /// Of all maps' marks.
    pub(super) fn new(marks: &[Vec<Mark>]) -> Self {
        let numbered: Vec<(usize, &Vec<Mark>)> = marks.iter().enumerate().collect();
        let of_maps = parallel::map(&numbered, |(map, marks)| {
            let mut words = Vec::new();
            each_word(marks, |kinds, (u, v, turn), (middle, way)| {
                let along = way.normalize();
                words.push(Word {
                    key: key(kinds, u.floor() as i64, v.floor() as i64, turn.round() as i64),
                    map: *map as u32,
                    middle: [middle.x as f32, middle.y as f32],
                    direction: along.y.atan2(along.x) as f32,
                    along: [along.x as f32, along.y as f32],
                });
            });
            words
        });
        let mut words = of_maps.concat();
        // A stable sort of maps in their order.
        words.sort_by_key(|w| w.key);
        let mut at = FxHashMap::default();
        let mut begin = 0;
        for k in 1..=words.len() {
            if k == words.len() || words[k].key != words[begin].key {
                at.insert(words[begin].key, (begin as u32, k as u32));
                begin = k;
            }
        }
        let most = ((COMMON * marks.len() as f64) as usize).max(LEAST_COMMON);
        Self { words, at, most, maps: marks.len() as f64 }
    }

    /// What the words of a map say of the transforms of others to it, by the other map: to put a few hundred votes in
    /// order again and again takes less than all at once.
    fn votes(&self, map: usize, marks: &[Vec<Mark>], centers: &[Vec2]) -> Vec<Votes> {
        let mut votes: Vec<Votes> = marks.iter().map(|_| Votes::default()).collect();
        each_word(&marks[map], |kinds, (u, v, turn), (middle, way)| {
            let (along, direction) = (way.normalize(), way.y.atan2(way.x));
            // Of the squares and directions around, those that are nearest.
            let (u0, v0) = ((u - 0.5).floor() as i64, (v - 0.5).floor() as i64);
            let nearest = turn.round();
            let second = nearest + (turn - nearest).signum();
            let turns = 1 + usize::from((turn - nearest).abs() > 0.25);
            for turn in [nearest, second].into_iter().take(turns) {
                for (du, dv) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let key = key(kinds, u0 + du, v0 + dv, turn as i64);
                    let Some((begin, end)) = self.at.get(&key) else { continue };
                    let words = &self.words[*begin as usize..*end as usize];
                    if words.len() > self.most {
                        continue;
                    }
                    let weight = (1.0 + self.maps / words.len() as f64).ln() as f32;
                    for w in words.iter().filter(|w| w.map as usize != map) {
                        let theta = direction - f64::from(w.direction);
                        let [to_middle, other] =
                            [w.middle, w.along].map(|[x, y]| Vec2::new(f64::from(x), f64::from(y)));
                        let arm = centers[w.map as usize] - to_middle;
                        let (s, c) = (other.perp(&along), other.dot(&along));
                        let center =
                            middle + Vec2::new(c * arm.x - s * arm.y, s * arm.x + c * arm.y);
                        let bins = [0.0, 0.5].map(|grid| bin(center, theta, grid));
                        let (at, theta) = ([center.x as f32, center.y as f32], theta as f32);
                        votes[w.map as usize].add(bins, Vote { weight, at, theta });
                    }
                }
            }
        });
        votes
    }

    /// Transforms of other maps to a map that many words agree on: `T_map_other`, those with the most votes first.
    pub(super) fn proposed(
        &self,
        map: usize,
        marks: &[Vec<Mark>],
        centers: &[Vec2],
    ) -> Vec<(usize, Se2)> {
        let mut votes = self.votes(map, marks, centers);
        let mut bins: Vec<(f32, usize, Range<usize>)> = Vec::new();
        for (other, votes) in votes.iter_mut().enumerate() {
            votes.binned.sort_unstable();
            let mut begin = 0;
            for alike in votes.binned.chunk_by(|x, y| x >> VOTE_BITS == y >> VOTE_BITS) {
                let weight = votes.of(alike).map(|v| f64::from(v.weight)).sum::<f64>();
                bins.push((weight as f32, other, begin..begin + alike.len()));
                begin += alike.len();
            }
        }
        // Those with the most votes, of equals the first.
        let place = |x: &(f32, usize, Range<usize>)| (x.1, x.2.start);
        let most_first = |x: &(f32, usize, Range<usize>), y: &(f32, usize, Range<usize>)| {
            y.0.total_cmp(&x.0).then(place(x).cmp(&place(y)))
        };
        if bins.len() > MAX_LOOKS {
            bins.select_nth_unstable_by(MAX_LOOKS, most_first);
            bins.truncate(MAX_LOOKS);
        }
        bins.sort_unstable_by(most_first);
        let transform = |(_, other, alike): (f32, usize, Range<usize>)| {
            let votes = &votes[other];
            let (at, theta) = mean(votes.of(&votes.binned[alike]));
            let turn = Se2::new(0.0, 0.0, theta);
            (other, Se2::from_parts(at - turn.rotate(centers[other]), theta))
        };
        bins.into_iter().map(transform).collect()
    }
}

/// A vote for one transform: where the other map's centre lies, and how it is turned.
struct Vote {
    weight: f32,
    at: [f32; 2],
    theta: f32,
}

/// Bits below the bin that number a vote: two maps' words agree far fewer times.
const VOTE_BITS: u32 = 29;

/// What the words say of one other map.
#[derive(Default)]
struct Votes {
    /// In the order in which they were found.
    votes: Vec<Vote>,
    /// The bins of each vote, and below them its number: numbers alone are quickly put in order.
    binned: Vec<u64>,
}

impl Votes {
    fn add(&mut self, bins: [u64; 2], vote: Vote) {
        let number = self.votes.len() as u64;
        debug_assert!(number >> VOTE_BITS == 0);
        self.binned.extend(bins.map(|bin| bin << VOTE_BITS | number));
        self.votes.push(vote);
    }

    fn of<'v>(&'v self, binned: &'v [u64]) -> impl Iterator<Item = &'v Vote> {
        binned.iter().map(|b| &self.votes[(b & ((1 << VOTE_BITS) - 1)) as usize])
    }
}

/// The means of some votes.
fn mean<'v>(mut votes: impl Iterator<Item = &'v Vote>) -> (Vec2, f64) {
    let Some(v) = votes.next() else { return (Vec2::zeros(), 0.0) };
    let first = f64::from(v.theta);
    let (mut weight, mut at, mut off) = (0.0, Vec2::zeros(), 0.0);
    for v in std::iter::once(v).chain(votes) {
        let w = f64::from(v.weight);
        weight += w;
        at += Vec2::new(f64::from(v.at[0]), f64::from(v.at[1])) * w;
        off += wrap(f64::from(v.theta) - first) * w;
    }
    (at / weight, first + off / weight)
}

/// The bin of a vote in one of two grids, shifted against each other by half a bin. The angle is a full turn
/// either way at most.
fn bin(center: Vec2, theta: f64, grid: f64) -> u64 {
    // Far enough for no map to lie below: what is positive is cut off, not rounded.
    const FAR: f64 = (1u64 << 32) as f64;
    let theta = if theta < 0.0 { theta + TAU } else { theta };
    let turn = (theta * VOTE_TURNS / TAU + grid) as i64 % VOTE_TURNS as i64;
    let at = |x: f64| (x / VOTE_CELL + grid + FAR) as i64 & 0x3fff;
    let grid = i64::from(grid > 0.0);
    (grid << 34 | turn << 28 | at(center.x) << 14 | at(center.y)) as u64
}
