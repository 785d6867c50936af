//! Arguments of `view`.

use std::path::PathBuf;

use clap::Args;

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// Output folder of `reconstruct` or `compare`.
    pub folder: PathBuf,

    /// Port on the loopback address; default: any free one.
    #[arg(long, value_name = "PORT")]
    pub port: Option<u16>,

    /// Also ask the desktop to open the address in a browser.
    #[arg(long)]
    pub open: bool,
}
