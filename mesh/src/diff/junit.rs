//! JUnit XML, the form of test reports that continuous-integration systems show.

use std::path::Path;

use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

use super::result::Difference;
use crate::files::{WriteError, write_atomically};

/// Why a test report cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum JunitError {
    /// The report cannot be put into words.
    #[error("the test report cannot be written as XML: {0}")]
    Xml(String),
    /// The file system refused.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// Writes a test case for each check, named after `subject`. Times are left out: the same comparison gives the same bytes.
///
/// # Errors
/// When the file cannot be written.
pub fn write_junit(path: &Path, subject: &str, difference: &Difference) -> Result<(), JunitError> {
    let cases = difference.checks.iter().map(|outcome| {
        let status = if outcome.passed {
            TestCaseStatus::success()
        } else {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
            status.set_message(outcome.message.as_str());
            status.set_type("difference");
            status
        };
        let mut case = TestCase::new(outcome.check.name(), status);
        case.set_classname(subject);
        case.set_system_out(outcome.message.as_str());
        case
    });
    write(path, subject, cases.collect())
}

/// Writes that the comparison could not be made.
///
/// # Errors
/// When the file cannot be written.
pub fn write_junit_failure(path: &Path, subject: &str, reason: &str) -> Result<(), JunitError> {
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
    status.set_message(reason);
    status.set_type("not compared");
    let mut case = TestCase::new("comparison", status);
    case.set_classname(subject);
    write(path, subject, vec![case])
}

fn write(path: &Path, subject: &str, cases: Vec<TestCase>) -> Result<(), JunitError> {
    let mut suite = TestSuite::new(subject);
    suite.add_test_cases(cases);
    let mut report = Report::new("linecarve diff");
    report.add_test_suite(suite);
    let text = report
        .to_string()
        .map_err(|error| JunitError::Xml(error.to_string()))?;
    write_atomically(path, |out| out.write_all(text.as_bytes()))?;
    Ok(())
}
