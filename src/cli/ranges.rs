//! Ranges of the numbers of the command line. A number outside is refused before anything is read.

use std::ops::RangeInclusive;

use clap::builder::RangedU64ValueParser;

/// Largest number of worker threads or processes.
pub(super) const MOST_WORKERS: u64 = 1024;
/// Largest number of frames or keyframes.
pub(super) const MOST_FRAMES: u64 = 1_000_000_000;
/// Largest number of samples of a shape.
pub(super) const MOST_SAMPLES: u64 = 100_000_000;
/// Largest length, in any unit.
const MOST_LENGTH: f64 = 1e9;
/// Least length above 0, in any unit.
const LEAST_LENGTH: f64 = 1e-9;

/// Whole numbers in a range.
pub(super) fn whole<T>(range: RangeInclusive<u64>) -> RangedU64ValueParser<T>
where
    T: TryFrom<u64> + Clone + Send + Sync,
{
    RangedU64ValueParser::new().range(range)
}

/// Numbers in a range.
pub(super) fn number(
    range: RangeInclusive<f64>,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    move |text| {
        let (least, most) = (range.start(), range.end());
        match text.trim().parse::<f64>() {
            Ok(number) if range.contains(&number) => Ok(number),
            _ => Err(format!("give a number from {least} to {most}")),
        }
    }
}

/// A length above 0.
pub(super) fn length() -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    number(LEAST_LENGTH..=MOST_LENGTH)
}

/// A coordinate.
pub(super) fn coordinate() -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync {
    number(-MOST_LENGTH..=MOST_LENGTH)
}

#[cfg(test)]
mod tests {
    use std::any::TypeId;

    use clap::error::ErrorKind;
    use clap::{Arg, Command, CommandFactory};

    use super::*;
    use crate::cli::Cli;

    /// Checks all options of a command and of the commands below it.
    fn check(command: &Command, above: &[String], checked: &mut usize) {
        for argument in command.get_arguments() {
            let kind = argument.get_value_parser().type_id();
            let is_one_of = |kinds: &[TypeId]| kinds.iter().any(|it| kind == *it);
            let is_whole = is_one_of(&[
                TypeId::of::<usize>(),
                TypeId::of::<u64>(),
                TypeId::of::<u32>(),
                TypeId::of::<u8>(),
            ]);
            // A seed is any number, and a port has no more than 16 bits.
            let is_counted = matches!(argument.get_action(), clap::ArgAction::Count);
            if is_counted || argument.get_id().as_str().ends_with("seed") {
                continue;
            }
            let hostile: &[&str] = if is_whole {
                &["18446744073709551615", "1000000000001", "-1", "1.5"]
            } else if is_one_of(&[TypeId::of::<f64>(), TypeId::of::<[f64; 3]>()]) {
                &[
                    "nan",
                    "inf",
                    "-inf",
                    "1e300",
                    "nan,0,0",
                    "inf,0,0",
                    "1e300,0,0",
                ]
            } else {
                continue;
            };
            for text in hostile {
                *checked += 1;
                let mut words = above.to_vec();
                words.extend(given(argument, text));
                let error = Cli::command().try_get_matches_from(&words).unwrap_err();
                assert_eq!(
                    error.kind(),
                    ErrorKind::ValueValidation,
                    "{words:?}: {error}"
                );
            }
        }
        for below in command.get_subcommands() {
            let mut path = above.to_vec();
            path.push(below.get_name().to_owned());
            check(below, &path, checked);
        }
    }

    /// An option with a value as it is written; a value without a name comes after as many others.
    fn given(argument: &Arg, text: &str) -> Vec<String> {
        match (argument.get_long(), argument.get_index()) {
            (Some(name), _) => vec![format!("--{name}={text}")],
            (None, Some(index)) => {
                let before = std::iter::repeat_n("frame", index - 1);
                let words = std::iter::once("--").chain(before).chain([text]);
                words.map(str::to_owned).collect()
            }
            (None, None) => panic!("{argument:?}"),
        }
    }

    #[test]
    fn every_number_of_the_command_line_has_a_range() {
        let mut command = Cli::command();
        command.build();
        let mut checked = 0;
        check(&command, &["linecarve".to_owned()], &mut checked);
        assert!(checked > 150, "{checked}");
    }

    #[test]
    fn numbers_are_read_within_their_range() {
        let share = number(0.0..=1.0);
        assert_eq!(share("0.5"), Ok(0.5));
        assert_eq!(share(" 1"), Ok(1.0));
        for bad in ["", "x", "-0.1", "1.1", "nan", "inf"] {
            assert!(share(bad).unwrap_err().contains("from 0 to 1"), "{bad}");
        }
    }
}
