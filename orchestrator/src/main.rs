//! sparring
fn main() {}
