//! Rebuilds when the dashboard was built.

use std::path::Path;

fn main() {
    // A release contains the dashboard's files; a debug build reads them from the folder.
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "release") {
        // If the dashboard has not been built, its folder is watched for the build.
        let built = Path::new("../dashboard/dist").exists();
        let watched = if built { "../dashboard/dist" } else { "../dashboard" };
        println!("cargo:rerun-if-changed={watched}");
    } else {
        println!("cargo:rerun-if-changed=build.rs");
    }
}
