//! Maps that come, change and go, merged again and again.
//!
//! A session keeps what depends on unchanged maps alone: prepared maps, their mirror images, registered pairs. Its
//! answers are those of [`crate::merge()`] on the same maps, bit for bit, whatever came before.

use crate::cache::{self, Cache, Digest, Noted};
use crate::config::Config;
use crate::error::{Error, Result};
use crate::fuse::{self, Fused};
use crate::grid::OccupancyGrid;
use crate::merge;
use crate::parallel;
use crate::result::{Known, Merge, Observer};
use crate::se2::Se2;
use crate::snap::{self, Snap};
use crate::standing::{self, Answer, Question};

struct Seen {
    grid: OccupancyGrid,
    digest: Digest,
}

/// See the module's text.
pub struct Session {
    config: Config,
    maps: Vec<Seen>,
    cache: Cache,
}

impl Session {
    /// A session without maps. What it keeps is valid for this configuration alone.
    pub fn new(config: Config) -> Result<Self> {
        config.validate()?;
        Ok(Self { config, maps: Vec::new(), cache: Cache::lasting() })
    }

    /// Takes a map in the place of the one of the same name, or as a new one. False when nothing changed.
    pub fn update(&mut self, grid: OccupancyGrid) -> bool {
        let digest = cache::digest(&grid);
        match self.maps.iter_mut().find(|m| m.grid.name() == grid.name()) {
            Some(seen) if seen.digest == digest => false,
            Some(seen) => {
                *seen = Seen { grid, digest };
                true
            }
            None => {
                self.maps.push(Seen { grid, digest });
                true
            }
        }
    }

    /// Forgets a map. False when there is none of that name.
    pub fn remove(&mut self, name: &str) -> bool {
        let before = self.maps.len();
        self.maps.retain(|m| m.grid.name() != name);
        self.maps.len() < before
    }

    /// Names of the maps, those that came first in front: the order of a merge.
    pub fn names(&self) -> Vec<&str> {
        self.maps.iter().map(|m| m.grid.name()).collect()
    }

    /// Registered pairs that are kept.
    pub fn kept_pairs(&self) -> usize {
        self.cache.pairs()
    }

    /// Merges the maps as they are now. Only what is new or changed is prepared and registered; what was done
    /// before the observer ended it need not be done again.
    pub fn merge(&mut self, known: &Known, observer: Observer) -> Result<Merge> {
        let current: Vec<Digest> = self.maps.iter().map(|m| m.digest).collect();
        let grids: Vec<Noted> = self.maps.iter().map(|m| (&m.grid, m.digest)).collect();
        self.cache.begin(&current);
        let found =
            merge::merge_with(&mut self.cache, &grids, known, &self.config, (observer, None));
        self.cache.end(found.is_err());
        found
    }

    /// How arrangements that were found earlier stand under the maps as they are now; indices are those of
    /// [`Session::names`].
    pub fn weigh(
        &mut self,
        known: &Known,
        questions: &[Question],
        observer: Observer,
    ) -> Result<Vec<Answer>> {
        let grids: Vec<Noted> = self.maps.iter().map(|m| (&m.grid, m.digest)).collect();
        standing::answers(&mut self.cache, &grids, known, &self.config, questions, observer)
    }

    /// Where some maps come to rest when they are let go near others, see [`snap::Snap`]; indices are those of
    /// [`Session::names`].
    pub fn snap(
        &mut self,
        question: &Question,
        decoy: f64,
        observer: Observer,
    ) -> Result<Option<Snap>> {
        let grids: Vec<Noted> = self.maps.iter().map(|m| (&m.grid, m.digest)).collect();
        snap::snap(&mut self.cache, &grids, question, decoy, &self.config, observer)
    }

    /// One map of some of the maps at poses `T_frame_map`, see [`fuse::fuse`].
    pub fn fuse(&self, name: &str, placed: &[(&str, Se2)]) -> Result<Fused> {
        let placed = placed.iter().map(|(map, t)| Ok((self.grid(map)?, *t)));
        let placed = placed.collect::<Result<Vec<_>>>()?;
        let fused = || fuse::fuse(name, &placed, &self.config.fuse);
        parallel::with_threads(self.config.threads, fused)?
    }

    fn grid(&self, name: &str) -> Result<&OccupancyGrid> {
        Ok(&self.maps[self.index(name)?].grid)
    }

    /// Index of the map of that name.
    pub fn index(&self, name: &str) -> Result<usize> {
        let missing = || Error::Grid {
            map: name.into(),
            field: "name",
            problem: "the session has no map of that name".into(),
        };
        self.maps.iter().position(|m| m.grid.name() == name).ok_or_else(missing)
    }
}
