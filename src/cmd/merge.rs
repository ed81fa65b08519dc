//! `umbrage merge`: the structures of several containers in one.

use std::path::PathBuf;

use umbrage::format::FileId;
use umbrage::format::checksum::content_hash;
use umbrage::reader::{Container, Structure};
use umbrage::writer::container::{ContainerOptions, ContainerWriter, PageInput};

use super::output::{self, line};
use super::{Failure, go_on, listen, open};

/// Arguments of `merge`.
#[derive(clap::Args)]
pub struct Args {
    /// Containers, at least two; their lights keep their names and order
    #[arg(required = true, num_args = 2.., value_name = "FILE.umb")]
    files: Vec<PathBuf>,
    /// The container to write
    #[arg(short, long, value_name = "FILE.umb")]
    output: PathBuf,
}

/// Runs the command.
pub fn run(args: Args) -> Result<(), Failure> {
    listen();
    let containers = args.files.iter().map(|f| open(f)).collect::<Result<Vec<_>, _>>()?;
    let structures: Vec<Structure> = containers.iter().flat_map(Container::structures).collect();
    // Cold structures stay cold: a model of the same pages is the same model.
    let cold: Vec<bool> = structures.iter().map(|s| s.cold_section().is_some()).collect();
    let id = merged_id(&containers);
    let options = if cold.iter().all(|c| *c) { ContainerOptions::cold(id) } else { ContainerOptions::new(id) };
    let records = structures.iter().map(|s| *s.record()).collect();
    let mut writer = ContainerWriter::create_each(&args.output, options, records, cold)?;
    for s in &structures {
        for ordinal in 0..s.page_count() {
            if !go_on() {
                return Err(Failure::interrupted());
            }
            let words = s.page_bytes(ordinal)?.check_frame()?.words().to_vec();
            let page = PageInput { words, record: s.page_record(ordinal)?, dependencies: s.dependencies(ordinal)? };
            writer.push(&page)?;
        }
    }
    let written = writer.finish()?;
    line(&format!("{} lights, {} pages, {}", structures.len(), written.pages, output::bytes(written.bytes)))?;
    line(&args.output.display().to_string())
}

/// Hash of the merged files' ids, in order.
fn merged_id(containers: &[Container]) -> FileId {
    let mut ids: Vec<u8> = b"merge".to_vec();
    containers.iter().for_each(|c| ids.extend_from_slice(c.file_id()));
    let low = content_hash(&ids);
    ids.push(1);
    (u128::from(low) | u128::from(content_hash(&ids)) << 64).to_le_bytes()
}
