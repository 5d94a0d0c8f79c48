//! Mapmeld's core: merges the occupancy grids of many robots (VR-SLAM).
#![warn(missing_docs)]
pub mod boundary;
pub mod cluster;
pub mod config;
pub mod distance;
pub mod error;
pub mod evidence;
pub mod filter;
pub mod fuse;
pub mod grid;
pub mod likelihood_field;
pub mod local_map;
pub mod merge;
pub mod parallel;
pub mod perception;
pub mod refine;
pub mod registration;
pub mod se2;
pub mod structure;
pub mod virtual_robot;
