//! Memory use of the process, and a limit for it.

use std::str::FromStr;

/// Peak resident memory in MB (10^6 bytes); `None` where the system does not report it.
pub fn peak_mb() -> Option<f64> {
    status_mb("VmHWM:")
}

/// Current resident memory in MB (10^6 bytes); `None` where the system does not report it.
pub fn resident_mb() -> Option<f64> {
    status_mb("VmRSS:")
}

/// Addresses of the process in MB (10^6 bytes), whether they hold anything or not; `None` where the system does not report it.
pub fn size_mb() -> Option<f64> {
    status_mb("VmSize:")
}

/// An entry of Linux' `/proc/self/status`, in units of 1024 bytes.
fn status_mb(entry: &str) -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with(entry))?;
    let kibibytes: f64 = line.split_ascii_whitespace().nth(1)?.parse().ok()?;
    Some((kibibytes * 1.024).round() / 1e3)
}

/// Limit for the resident memory at the end of a keyframe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MemoryLimit {
    /// In MB (10^6 bytes).
    pub megabytes: f64,
}

impl FromStr for MemoryLimit {
    type Err = String;

    /// Reads `800M`, `2G` or `1.5GB`: powers of ten.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let bare = text.trim().trim_end_matches(['B', 'b']);
        let units = [('M', 1.0), ('m', 1.0), ('G', 1e3), ('g', 1e3)];
        units
            .iter()
            .find_map(|(unit, factor)| Some((bare.strip_suffix(*unit)?, factor)))
            .and_then(|(number, factor)| Some(number.trim().parse::<f64>().ok()? * factor))
            .filter(|megabytes| megabytes.is_finite() && *megabytes > 0.0)
            .map(|megabytes| Self { megabytes })
            .ok_or_else(|| "a number with a unit is needed, for example 800M or 2G".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_have_a_unit() {
        let read = |text: &str| text.parse::<MemoryLimit>().map(|limit| limit.megabytes);
        assert_eq!(read("800M"), Ok(800.0));
        assert_eq!(read("1.5GB"), Ok(1500.0));
        assert_eq!(read("2 g"), Ok(2000.0));
        for bad in [
            "", "2", "M", "-1G", "0M", "nanG", "infM", "2T", "MG", "1e400G",
        ] {
            assert!(read(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn resident_memory_is_at_most_the_peak() {
        if let (Some(resident), Some(peak)) = (resident_mb(), peak_mb()) {
            assert!(resident > 0.1 && resident <= peak, "{resident} {peak}");
        }
    }
}
