//! Environment variables of flags: `serve` has one for every flag, so that a container needs no command line.

use clap::{Arg, Command};

/// Adds `SPARRING_…` to each flag of `serve` that has no variable.
pub(super) fn add_variables(definition: Command) -> Command {
    definition.mut_subcommands(|sub| {
        if sub.get_name() != "serve" {
            return sub;
        }
        sub.mut_args(|arg| match arg.get_long() {
            Some(flag) if arg.get_env().is_none() && flag != "help" => {
                let name = variable_name(flag);
                arg.env(name).hide_env_values(true)
            }
            _ => arg,
        })
    })
}

/// Returns the variable of a flag: `SPARRING_SESSION_IDLE` for `--session-idle`.
fn variable_name(flag: &str) -> String {
    format!("SPARRING_{}", flag.to_uppercase().replace('-', "_"))
}

/// Returns the name of a flag's environment variable, if it has one.
pub(super) fn variable(arg: &Arg) -> Option<String> {
    arg.get_env().map(|name| name.to_string_lossy().into_owned())
}
