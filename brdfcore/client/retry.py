"""When a request is tried again, after how long, and when to give up: one total deadline a request."""

from __future__ import annotations

import socket
import ssl
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from random import random
from time import monotonic

import httpx2

from brdfcore.base.errors import InputError
from brdfcore.client.calls import Answer, Call
from brdfcore.client.errors import DeadlineError, ServiceError, problem_of

#: Answers after which the same request may go better in a moment.
_BUSY = (502, 503, 504)
#: Failures before a byte was sent.
_NEVER_SENT = (httpx2.ConnectError, httpx2.ConnectTimeout, httpx2.PoolTimeout)
#: Failures on the way: the service may have done it.
_BROKEN_OFF = (httpx2.NetworkError, httpx2.RemoteProtocolError)


@dataclass(frozen=True)
class RetryPolicy:
    """How long a request may take, all its attempts and pauses together, and how the pauses grow.

    deadline       seconds; 0 means one attempt.
    first_pause    seconds after the first failure; doubled after each further one.
    longest_pause  seconds. A service's Retry-After may ask for more, and is obeyed if the deadline allows.
    """

    deadline: float = 60.0
    first_pause: float = 0.1
    longest_pause: float = 3.0

    def __post_init__(self) -> None:
        for name in ("deadline", "first_pause", "longest_pause"):
            value = getattr(self, name)
            if not (isinstance(value, (int, float)) and 0 <= value < float("inf")):
                raise InputError(
                    "bad_option", f"{name}: expected seconds >= 0, got {value!r}", where=name, expected="seconds >= 0"
                )

    def pause(self, failures: int, share: float) -> float:
        """Seconds to wait after so many failures; `share` in [0, 1] is the jitter: half of it is at random, so that
        many clients of a restarted service don't come back at the same moment."""
        full = min(self.longest_pause, self.first_pause * 2.0 ** min(failures - 1, 30))
        return full * (0.5 + 0.5 * share)


class Attempts:
    """The attempts of one request. Asks nothing of the network: it is told what happened and says what to do."""

    def __init__(self, call: Call, policy: RetryPolicy, base: str) -> None:
        self._call, self._policy, self._base = call, policy, base
        self._started = monotonic()
        self._failures = 0

    def left(self) -> float:
        """Seconds until the deadline; infinite without one."""
        if self._policy.deadline == 0:
            return float("inf")
        return self._policy.deadline - (monotonic() - self._started)

    def check_time(self) -> None:
        """`DeadlineError` when an answer takes longer than the deadline to arrive."""
        if self.left() <= 0:
            raise self._over("the answer was still arriving")

    def after_failure(self, error: httpx2.TransportError) -> float:
        """Seconds to wait before the next attempt, after one without an answer.

        Raises `ServiceError` if this must not be repeated, `DeadlineError` if the time is over.
        """
        self._failures += 1
        said = f"{type(error).__name__}: {error}".rstrip(": ")
        if isinstance(error, httpx2.TimeoutException) and not isinstance(error, _NEVER_SENT):
            # the service is at work or lost: asking again would only double its work
            raise self._over(f"no answer in time ({said})") from error
        repeatable = isinstance(error, _NEVER_SENT) or (isinstance(error, _BROKEN_OFF) and self._call.repeat == "any")
        if not repeatable or _is_lasting(error) or self._call.repeat == "none" or self._policy.deadline == 0:
            done = "" if isinstance(error, _NEVER_SENT) else "; whether it was done is not known"
            raise ServiceError(
                "connection_failed",
                f"{self._call.method} {self._base}: {said}{done}; does the service run there?",
                where=self._base,
                got=said,
                attempts=self._failures,
            ) from error
        return self._wait(said, None, error)

    def after_answer(self, answer: Answer) -> float | None:
        """Seconds to wait before the next attempt, or None if the answer counts. Raises as `after_failure`."""
        if answer.status not in _BUSY or self._call.repeat == "none" or self._policy.deadline == 0:
            return None
        if self._call.repeat == "undone" and answer.status != 503:
            return None  # the service behind a proxy may have done it
        self._failures += 1
        problem = problem_of(answer.content)
        said = f"answered {answer.status}" + (f", {problem['code']}: {problem['detail']}" if problem else "")
        return self._wait(said, retry_after(answer.headers.get("retry-after", "")), None)

    def _wait(self, said: str, asked: float | None, cause: Exception | None) -> float:
        seconds = self._policy.pause(self._failures, random())
        if asked is not None:
            seconds = max(asked, seconds)
        if seconds >= self.left():
            raise self._over(said if asked is None else f"{said}; it asks to wait {asked:g} s") from cause
        return seconds

    def _over(self, said: str) -> DeadlineError:
        seconds = monotonic() - self._started
        tries = f"{self._failures} attempt{'s' if self._failures != 1 else ''}" if self._failures else "one attempt"
        return DeadlineError(
            "deadline_exceeded",
            f"{self._call.method} {self._base}{self._call.path.partition('?')[0]}: gave up after {seconds:.1f} s and "
            f"{tries} (deadline {self._policy.deadline:g} s); the last: {said}",
            where=self._base,
            seconds=seconds,
            attempts=max(self._failures, 1),
            got=said,
            hint="deadline= and timeout= of the client say how long it waits",
        )


def _is_lasting(error: BaseException | None) -> bool:
    """True if waiting does not help: there is no host of that name, or it is not the one its certificate names."""
    while error is not None:
        if isinstance(error, ssl.SSLError) or (isinstance(error, socket.gaierror) and error.errno == socket.EAI_NONAME):
            return True
        error = error.__cause__ or error.__context__
    return False


def retry_after(text: str) -> float | None:
    """Seconds that a Retry-After header asks to wait (a number or a date), None if it is absent or unreadable."""
    text = text.strip()
    if text.isascii() and text.isdigit():
        return float(text[:9])
    try:
        moment = parsedate_to_datetime(text)
    except ValueError:
        return None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=UTC)
    return max(0.0, (moment - datetime.now(UTC)).total_seconds())
