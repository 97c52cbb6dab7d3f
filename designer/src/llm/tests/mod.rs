//! The designer against endpoints that misbehave.
