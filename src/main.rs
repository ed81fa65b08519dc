//! The command line `umbrage`: one small file per subcommand in `cmd`.
#![forbid(unsafe_code)]

mod cmd;

use std::process::ExitCode;

use clap::Parser;

/// Precomputed shadows: bake a scene's light losslessly, look it up, stream it.
#[derive(Parser)]
#[command(version, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: cmd::Command,
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            let _ = e.print();
            return ExitCode::from(if e.use_stderr() { cmd::USAGE } else { 0 });
        }
    };
    match cli.command.run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            // code 0: the reader of a pipe has had enough
            if failure.code != 0 {
                eprintln!("umbrage: {}", failure.message);
            }
            ExitCode::from(failure.code)
        }
    }
}
