//! JUnit XML test reports, which continuous-integration systems display.

use std::fmt::Write;
use std::path::Path;

use super::result::Difference;
use crate::files::{WriteError, write_atomically};

/// Writes one test case per check, with `subject` as class name.
///
/// The report holds no times: the same comparison writes the same bytes.
///
/// # Errors
/// When the file cannot be written.
pub fn write_junit(path: &Path, subject: &str, difference: &Difference) -> Result<(), WriteError> {
    let cases: Vec<TestCase<'_>> = difference
        .checks
        .iter()
        .map(|outcome| TestCase {
            name: outcome.check.name(),
            failure: (!outcome.passed).then_some(Failure {
                element: "failure",
                message: &outcome.message,
                kind: "difference",
            }),
            output: Some(&outcome.message),
        })
        .collect();
    write(path, subject, &cases)
}

/// Writes a report with one error: the comparison was not possible for the given reason.
///
/// # Errors
/// When the file cannot be written.
pub fn write_junit_failure(path: &Path, subject: &str, reason: &str) -> Result<(), WriteError> {
    let case = TestCase {
        name: "comparison",
        failure: Some(Failure {
            element: "error",
            message: reason,
            kind: "not compared",
        }),
        output: None,
    };
    write(path, subject, &[case])
}

/// One `testcase` element.
struct TestCase<'a> {
    name: &'a str,
    failure: Option<Failure<'a>>,
    /// Content of `system-out`.
    output: Option<&'a str>,
}

/// The child element of a test case that did not pass.
struct Failure<'a> {
    /// `failure` or `error`.
    element: &'static str,
    message: &'a str,
    kind: &'static str,
}

fn write(path: &Path, subject: &str, cases: &[TestCase<'_>]) -> Result<(), WriteError> {
    let text = document(subject, cases);
    write_atomically(path, |out| out.write_all(text.as_bytes()))
}

fn document(subject: &str, cases: &[TestCase<'_>]) -> String {
    let count = |element: &str| {
        let failures = cases.iter().filter_map(|case| case.failure.as_ref());
        failures.filter(|f| f.element == element).count()
    };
    let (tests, failures, errors) = (cases.len(), count("failure"), count("error"));
    let subject = Escaped(subject);
    let mut text = format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<testsuites name="linecarve diff" tests="{tests}" skipped="0" failures="{failures}" errors="{errors}">
    <testsuite name="{subject}" tests="{tests}" skipped="0" errors="{errors}" failures="{failures}">
"#
    );
    let mut line = |arguments: std::fmt::Arguments<'_>| {
        // Writing into a `String` cannot fail.
        let _ = writeln!(text, "{arguments}");
    };
    for case in cases {
        let name = Escaped(case.name);
        line(format_args!(
            r#"        <testcase name="{name}" classname="{subject}">"#
        ));
        if let Some(failure) = &case.failure {
            let Failure { element, kind, .. } = failure;
            let message = Escaped(failure.message);
            line(format_args!(
                r#"            <{element} message="{message}" type="{kind}"/>"#
            ));
        }
        if let Some(output) = case.output.map(Escaped) {
            line(format_args!(
                "            <system-out>{output}</system-out>"
            ));
        }
        line(format_args!("        </testcase>"));
    }
    text.push_str("    </testsuite>\n</testsuites>\n");
    text
}

/// Text as the content of an XML element or a quoted attribute value.
///
/// Characters that XML 1.0 does not allow are left out. Tabs and line ends are written as character references, because
/// parsers turn them into spaces in attribute values.
#[derive(Clone, Copy)]
struct Escaped<'a>(&'a str);

impl std::fmt::Display for Escaped<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for character in self.0.chars() {
            match character {
                '<' => formatter.write_str("&lt;")?,
                '>' => formatter.write_str("&gt;")?,
                '&' => formatter.write_str("&amp;")?,
                '\'' => formatter.write_str("&apos;")?,
                '"' => formatter.write_str("&quot;")?,
                '\t' | '\n' | '\r' => write!(formatter, "&#{};", u32::from(character))?,
                '\0'..='\x1f' | '\u{fffe}' | '\u{ffff}' => {}
                other => formatter.write_char(other)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_escapes_what_xml_reserves_and_drops_what_it_forbids() {
        let cases = [
            TestCase {
                name: "distance",
                failure: Some(Failure {
                    element: "failure",
                    message: "0.2 > 0.1\nat \"a\"\u{1b}[0m\0",
                    kind: "difference",
                }),
                output: Some("it's 0.2"),
            },
            TestCase {
                name: "bounds",
                failure: None,
                output: Some("equal"),
            },
        ];
        let expected = r#"<?xml version="1.0" encoding="UTF-8"?>
<testsuites name="linecarve diff" tests="2" skipped="0" failures="1" errors="0">
    <testsuite name="a &amp; &lt;b&gt;" tests="2" skipped="0" errors="0" failures="1">
        <testcase name="distance" classname="a &amp; &lt;b&gt;">
            <failure message="0.2 &gt; 0.1&#10;at &quot;a&quot;[0m" type="difference"/>
            <system-out>it&apos;s 0.2</system-out>
        </testcase>
        <testcase name="bounds" classname="a &amp; &lt;b&gt;">
            <system-out>equal</system-out>
        </testcase>
    </testsuite>
</testsuites>
"#;
        assert_eq!(document("a & <b>", &cases), expected);
    }

    #[test]
    fn a_comparison_that_fails_is_one_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.xml");
        write_junit_failure(&path, "a b", "no such file").unwrap();
        let text = std::fs::read_to_string(path).unwrap();
        assert!(text.contains(r#"tests="1" skipped="0" failures="0" errors="1""#));
        assert!(text.contains(r#"<error message="no such file" type="not compared"/>"#));
    }
}
