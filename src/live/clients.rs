//! Messages that wait for each client, within bounds.

use std::collections::{BTreeMap, VecDeque};

use hyper::body::Bytes;

/// Largest number of bytes that wait for a client. Beyond it the client gets the whole state in their place.
const MOST_BYTES: usize = 16 << 20;
/// Largest number of messages that wait for a client.
const MOST_MESSAGES: usize = 64;
/// Largest number of clients.
pub(super) const MOST_CLIENTS: usize = 8;

/// What a client is to be sent next.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Next {
    /// The whole state.
    Whole,
    /// This message.
    Message(Bytes),
    /// Nothing so far.
    Nothing,
}

/// Messages for one client.
#[derive(Debug)]
struct Queue {
    messages: VecDeque<Bytes>,
    bytes: usize,
    /// Whether the client needs the whole state first; no message waits then.
    needs_whole: bool,
}

/// The clients that are connected.
#[derive(Debug, Default)]
pub(super) struct Clients {
    queues: BTreeMap<u64, Queue>,
    next: u64,
}

impl Clients {
    /// A new client, which gets the whole state first; `None` when there are too many.
    pub(super) fn connect(&mut self) -> Option<u64> {
        if self.queues.len() >= MOST_CLIENTS {
            return None;
        }
        self.next += 1;
        let queue = Queue {
            messages: VecDeque::new(),
            bytes: 0,
            needs_whole: true,
        };
        self.queues.insert(self.next, queue);
        Some(self.next)
    }

    /// Forgets a client.
    pub(super) fn disconnect(&mut self, client: u64) {
        self.queues.remove(&client);
    }

    /// Whether a client needs a message: one that is to get the whole state anyway does not.
    pub(super) fn want_messages(&self) -> bool {
        self.queues.values().any(|queue| !queue.needs_whole)
    }

    /// Appends a message for every client. A queue that becomes too long is emptied, and its client gets the whole state.
    pub(super) fn push(&mut self, message: &Bytes) {
        for queue in self.queues.values_mut().filter(|queue| !queue.needs_whole) {
            queue.bytes += message.len();
            queue.messages.push_back(message.clone());
            if queue.bytes > MOST_BYTES || queue.messages.len() > MOST_MESSAGES {
                queue.messages.clear();
                queue.bytes = 0;
                queue.needs_whole = true;
            }
        }
    }

    /// Takes what a client is to be sent next. A whole state that is to be sent has to be made before another message is pushed.
    pub(super) fn take(&mut self, client: u64) -> Next {
        let Some(queue) = self.queues.get_mut(&client) else {
            return Next::Nothing;
        };
        if std::mem::take(&mut queue.needs_whole) {
            return Next::Whole;
        }
        match queue.messages.pop_front() {
            Some(message) => {
                queue.bytes -= message.len();
                Next::Message(message)
            }
            None => Next::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(text: &str) -> Bytes {
        text.to_owned().into()
    }

    #[test]
    fn a_client_gets_the_whole_state_and_then_messages_in_order() {
        let mut clients = Clients::default();
        let client = clients.connect().unwrap();
        clients.push(&message("before"));
        assert!(!clients.want_messages());
        assert_eq!(clients.take(client), Next::Whole);
        assert_eq!(clients.take(client), Next::Nothing);
        assert!(clients.want_messages());
        clients.push(&message("a"));
        clients.push(&message("b"));
        assert_eq!(clients.take(client), Next::Message(message("a")));
        assert_eq!(clients.take(client), Next::Message(message("b")));
        assert_eq!(clients.take(client), Next::Nothing);
    }

    #[test]
    fn a_slow_client_loses_its_queue_and_gets_the_whole_state() {
        let mut clients = Clients::default();
        let [slow, fast] = [(); 2].map(|()| clients.connect().unwrap());
        assert_eq!(clients.take(slow), Next::Whole);
        assert_eq!(clients.take(fast), Next::Whole);
        for number in 0..=MOST_MESSAGES {
            clients.push(&message(&number.to_string()));
            assert_eq!(
                clients.take(fast),
                Next::Message(message(&number.to_string()))
            );
        }
        assert_eq!(clients.take(slow), Next::Whole);
        assert_eq!(clients.take(slow), Next::Nothing);
        clients.push(&message("after"));
        assert_eq!(clients.take(slow), Next::Message(message("after")));
    }

    #[test]
    fn bytes_are_bounded_too() {
        let mut clients = Clients::default();
        let client = clients.connect().unwrap();
        assert_eq!(clients.take(client), Next::Whole);
        let long = message(&"x".repeat(MOST_BYTES / 2));
        for _ in 0..5 {
            clients.push(&long);
            assert_eq!(clients.take(client), Next::Message(long.clone()));
        }
        clients.push(&long);
        clients.push(&long);
        clients.push(&long);
        assert_eq!(clients.take(client), Next::Whole);
    }

    #[test]
    fn the_number_of_clients_is_bounded() {
        let mut clients = Clients::default();
        let all: Vec<_> = (0..MOST_CLIENTS)
            .filter_map(|_| clients.connect())
            .collect();
        assert_eq!(all.len(), MOST_CLIENTS);
        assert_eq!(clients.connect(), None);
        clients.disconnect(all[0]);
        assert!(clients.connect().is_some());
    }
}
