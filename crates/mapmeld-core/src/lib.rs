//! Mapmeld's core: merges the occupancy grids of many robots (VR-SLAM).
//!
//! Frames: every map has a frame of its own, in which its `origin` is given. A component of maps that
//! belong together has the frame of its reference map. `T_a_b` takes coordinates of frame b to frame a.
//! Metres, radians, x forward, y left (REP 103).
//!
//! ```
//! use mapmeld_core::{merge, Config, Known, OccupancyGrid, Se2};
//!
//! // Two drawings of one L-shaped room, the second from a frame shifted by a metre.
//! let draw = |x0: f64| {
//!     let wall = |x: f64, y: f64| {
//!         let outside = x < 0.0 || y < 0.0 || x > 6.0 || y > 4.0 || (x > 3.5 && y > 2.2);
//!         let clear = x > 0.1 && y > 0.1 && x < 5.9 && y < 3.9 && !(x > 3.4 && y > 2.1);
//!         if outside { -1 } else if clear { 0 } else { 100 }
//!     };
//!     let cells = (0..90 * 130).map(|i| wall((i % 130) as f64 * 0.05 - x0, (i / 130) as f64 * 0.05 - 0.2));
//!     OccupancyGrid::new("room", 130, 90, 0.05, Se2::IDENTITY, cells.collect()).unwrap()
//! };
//! let maps = vec![draw(0.2), draw(0.4)];
//! let merged = merge(maps, &Known::default(), &Config::default(), &|_, _, _| true).unwrap();
//! let shift = merged.placements[1].t_component_map.unwrap().x - merged.placements[0].t_component_map.unwrap().x;
//! assert!((shift + 0.2).abs() < 0.05);
//! ```
#![warn(missing_docs)]
pub mod batch;
pub mod blocks;
pub mod boundary;
pub mod cache;
pub mod canonical;
mod catchment;
pub mod cluster;
pub mod config;
pub mod distance;
pub mod error;
pub mod events;
pub mod evidence;
pub mod filter;
mod forbidden;
pub mod fuse;
pub mod grid;
pub mod ground;
pub mod joining;
pub mod likelihood_field;
pub mod local_map;
pub mod memory;
pub mod merge;
pub mod pair_table;
pub mod parallel;
pub mod partners;
pub mod perception;
pub mod prior;
pub mod probe;
pub mod refine;
pub mod registration;
pub mod relation;
pub mod result;
pub mod se2;
pub mod session;
pub mod snap;
pub mod sparse;
mod specks;
pub mod standing;
pub mod stored;
mod strays;
pub mod structure;
mod support;
pub mod verdict;
pub mod vicinity;
pub mod virtual_robot;

pub use config::Config;
pub use error::{Error, Result};
pub use grid::OccupancyGrid;
pub use local_map::LocalMap;
pub use merge::merge;
pub use result::{Known, Merge};
pub use se2::Se2;
pub use session::Session;
