//! The machine that a benchmark runs on.

use env_core::tasking::tick::dispatch::InstructionSet;

/// Model of the processor as Linux names it, or its architecture.
#[must_use]
pub fn cpu_model() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    model_name(&text).unwrap_or(std::env::consts::ARCH).to_owned()
}

/// Model in the text of `/proc/cpuinfo`, which names it for each core.
fn model_name(text: &str) -> Option<&str> {
    let line = text.lines().find_map(|line| line.strip_prefix("model name"))?;
    line.split_once(':').map(|(_, name)| name.trim()).filter(|name| !name.is_empty())
}

/// Widest instruction set for which the simulations have code, and that this machine has.
#[must_use]
pub fn instruction_set() -> &'static str {
    InstructionSet::detect().name()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_of_a_processor_is_read() {
        let text = "processor\t: 0\nmodel name\t: Fast CPU @ 3 GHz\nmodel name\t: Other\n";
        assert_eq!(model_name(text), Some("Fast CPU @ 3 GHz"));
        assert_eq!(model_name("CPU architecture: 8\n"), None);
        assert_eq!(model_name("model name\t:\n"), None);
        assert!(!cpu_model().is_empty() && !instruction_set().is_empty());
    }
}
