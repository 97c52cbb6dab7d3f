//! The whole system, in one program: linked once, and while one test waits another computes.

#![expect(clippy::unwrap_used, reason = "a test that finds something else than it wants must fail")]

mod access;
mod bad_input;
mod curricula;
mod database;
mod db_command;
mod design;
mod docking;
mod documents;
mod failures;
mod faults;
mod feed;
mod first_loop;
mod held_to_document;
mod hostile;
mod leases;
mod openenv;
mod openenv_clients;
mod physics;
mod play;
mod report;
mod restart;
mod retention;
mod shown;
mod stepping;
mod stubs;
mod survival;
mod trajectories;
