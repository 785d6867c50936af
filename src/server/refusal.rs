//! Requests that are not answered with what they ask for.

use hyper::{Method, Request, StatusCode, header};

use super::{Answer, Body};

/// Why a request is not answered with what it asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// It names another host.
    Name,
    /// It is neither GET nor HEAD.
    Method,
    /// It has a body.
    Body,
    /// There is no such file.
    Missing,
    /// There are too many clients.
    Busy,
}

impl Refusal {
    pub(super) fn status(self) -> StatusCode {
        match self {
            Self::Name => StatusCode::FORBIDDEN,
            Self::Missing => StatusCode::NOT_FOUND,
            Self::Method => StatusCode::METHOD_NOT_ALLOWED,
            Self::Body => StatusCode::PAYLOAD_TOO_LARGE,
            Self::Busy => StatusCode::SERVICE_UNAVAILABLE,
        }
    }

    pub(super) fn answer(self) -> Answer {
        let text = match self {
            Self::Name => "this address answers on the loopback name only\n",
            Self::Missing => "no such file\n",
            Self::Method => "only GET and HEAD\n",
            Self::Body => "a request has no body here\n",
            Self::Busy => "too many pages are open\n",
        };
        Answer {
            content_type: "text/plain; charset=utf-8",
            body: Body::whole(text),
        }
    }
}

/// Why a request is not answered, whatever its path: its method, its body, or the name by which it calls this address. A page elsewhere
/// whose name was made to point here gives that name.
pub(super) fn refusal<B: hyper::body::Body>(request: &Request<B>, port: u16) -> Option<Refusal> {
    let hosts = request.headers().get_all(header::HOST).iter();
    let mut names = hosts
        .map(|host| host.as_bytes())
        .chain(request.uri().authority().map(|it| it.as_str().as_bytes()));
    if !names.all(|name| is_own_name(name, port)) {
        return Some(Refusal::Name);
    }
    if !matches!(*request.method(), Method::GET | Method::HEAD) {
        return Some(Refusal::Method);
    }
    (!request.body().is_end_stream()).then_some(Refusal::Body)
}

/// Whether a client calls this address by a name of the loopback address. Clients leave out port 80.
fn is_own_name(name: &[u8], port: u16) -> bool {
    ["127.0.0.1", "localhost"].iter().any(|own| {
        let with_port = format!("{own}:{port}");
        name.eq_ignore_ascii_case(with_port.as_bytes())
            || (port == 80 && name.eq_ignore_ascii_case(own.as_bytes()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_port_may_be_left_out_when_it_is_80() {
        for (name, port, is_own) in [
            ("127.0.0.1:8080", 8080, true),
            ("LocalHost:8080", 8080, true),
            ("localhost", 80, true),
            ("127.0.0.1:80", 80, true),
            ("localhost", 8080, false),
            ("localhost:80", 8080, false),
            ("localhost.example:8080", 8080, false),
            ("elsewhere.example", 80, false),
            ("", 80, false),
        ] {
            assert_eq!(is_own_name(name.as_bytes(), port), is_own, "{name} {port}");
        }
    }

    #[test]
    fn all_names_have_to_be_own_ones() {
        let request = |uri: &str, hosts: &[&str]| {
            let mut request = Request::builder().uri(uri);
            for host in hosts {
                request = request.header(header::HOST, *host);
            }
            request.body(Body::whole("")).unwrap()
        };
        let own = "127.0.0.1:8080";
        assert_eq!(refusal(&request("/", &[own]), 8080), None);
        assert_eq!(refusal(&request("/", &[]), 8080), None);
        for request in [
            request("/", &["a.example"]),
            request("/", &[own, "a.example"]),
            request("http://a.example/", &[own]),
        ] {
            assert_eq!(refusal(&request, 8080), Some(Refusal::Name));
        }
    }
}
