//! Where published figures come from: commit, machine, command, date.

use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

/// Where figures come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Provenance {
    /// Short hash of the commit of the working folder; `unknown` outside a repository.
    pub commit: String,
    /// Number of cores, processor, operating system.
    pub machine: String,
    /// The command.
    pub command: String,
    /// Date as YYYY-MM-DD.
    pub date: String,
}

impl Provenance {
    /// Of figures that `command` measures now. `date` replaces that of the system.
    pub fn new(command: String, date: Option<&str>) -> Self {
        Self {
            commit: commit(),
            machine: machine(),
            command,
            date: date.map_or_else(today, str::to_owned),
        }
    }

    /// One line of Markdown for each.
    pub fn markdown(&self) -> String {
        let build = match cfg!(debug_assertions) {
            true => "development build",
            false => "release build",
        };
        format!(
            "Commit {}, {}; {build}; {}.\n\n```sh\n{}\n```\n",
            self.commit, self.machine, self.date, self.command
        )
    }
}

fn commit() -> String {
    let output = Command::new("git")
        .args(["rev-parse", "--short", "HEAD"])
        .output();
    output
        .ok()
        .filter(|output| output.status.success())
        .and_then(|output| String::from_utf8(output.stdout).ok())
        .map_or_else(|| "unknown".to_owned(), |hash| hash.trim().to_owned())
}

fn machine() -> String {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let information = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = information
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(':'))
        .map_or(std::env::consts::ARCH, |(_, model)| model.trim());
    format!("{cores} cores, {model}, {}", std::env::consts::OS)
}

fn today() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    date_of_day(since.map_or(0, |since| since.as_secs() / 86_400))
}

/// The date of a day, counted from 1970-01-01, in the Gregorian calendar.
///
/// # Reference
/// H. Hinnant, `chrono`-Compatible Low-Level Date Algorithms, 2013, `civil_from_days`.
fn date_of_day(day: u64) -> String {
    // Years begin in March, so that the leap day is the last of its year; an era has 400 years.
    let shifted = day + 719_468;
    let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
    let year_of_era =
        (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = 400 * era + year_of_era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day_of_month:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_dates_of_the_gregorian_calendar() {
        for (day, date) in [
            (0, "1970-01-01"),
            (58, "1970-02-28"),
            (59, "1970-03-01"),
            (11_016, "2000-02-29"),
            (11_017, "2000-03-01"),
            (20_779, "2026-11-22"),
            (47_540, "2100-02-28"),
            (47_541, "2100-03-01"),
        ] {
            assert_eq!(date_of_day(day), date);
        }
    }

    #[test]
    fn the_date_can_be_given() {
        let provenance = Provenance::new("linecarve-lab".to_owned(), Some("2026-11-22"));
        assert_eq!(provenance.date, "2026-11-22");
        assert!(provenance.markdown().contains("; 2026-11-22.\n"));
        assert!(!provenance.commit.is_empty() && provenance.machine.contains("cores"));
    }
}
