//! Rebuilds when a migration is added, and when the dashboard was built.

use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=../migrations");
    // A debug build reads the dashboard's files from where they lie; others have them in them.
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "release") {
        // Where it was never built there is no such folder; what is watched then is where it would be.
        let built = Path::new("../dashboard/dist").exists();
        let watched = if built { "../dashboard/dist" } else { "../dashboard" };
        println!("cargo:rerun-if-changed={watched}");
    }
}
