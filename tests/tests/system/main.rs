//! Whole-system tests against real servers.
//!
//! All tests are one executable, so that it is linked once and tests run while others wait. Each module has the tests
//! of one area; helpers that several areas share are in the library `system_tests`.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

mod access;
mod alerts;
mod api_conformance;
mod api_page;
mod bad_input;
#[cfg(target_os = "linux")]
mod child_processes;
mod configuration_file;
mod crash;
mod curricula;
mod database;
mod db_command;
mod design;
mod docking;
mod documents;
mod evidence;
mod failures;
mod faults;
mod feed;
mod feed_stream;
mod fuzz;
mod integer_bounds;
mod kills;
mod lease_purposes;
mod leases;
mod mcp_command;
mod network;
mod openenv;
mod openenv_clients;
mod physics;
mod plans;
mod play;
mod policy_files;
mod printed_commands;
mod python_stubs;
mod remote_workers;
mod report;
mod restart;
mod retention;
mod run_deletion;
mod run_list;
mod run_tags;
mod runs_command;
mod scale;
mod serve_command;
#[cfg(unix)]
mod shards;
mod stepping;
mod tasking;
mod trainer_metrics;
mod trainers;
mod training_loop;
mod trajectories;
mod views;
