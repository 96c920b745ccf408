"""The database of a ROS 2 bag (rosbag2's ``sqlite3`` storage), read in the order of its rows."""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from farpoint.errors import InputError
from farpoint.frames.bags.records import Message, Topic

__all__ = ["MAGIC", "SqliteBag"]

MAGIC = b"SQLite format 3\0"

_ONE_BY_ONE = 64
"""Number of rows that are read one by one after an unreadable row."""


class SqliteBag:
    """A ``.db3`` file.

    Parameters
    ----------
    path : Path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._topics: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """Topics from the tables of the bag, with a count of None if counting fails."""
        with closing(self._connect()) as database:
            try:
                definitions = self._definitions(database)
                rows = database.execute(
                    "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
                ).fetchall()
            except sqlite3.Error as error:
                raise InputError(
                    f"cannot be read as a bag of ROS 2 ({error})", file=self.path
                ) from error
            counts = self._counts(database)
            for number, *words in rows:
                name, kind, encoding = map(str, words)
                definition, is_idl = definitions.get(kind, ("", False))
                self._topics[number] = Topic(
                    name=name,
                    type_name=kind,
                    encoding=encoding,
                    definition=definition,
                    is_idl=is_idl,
                    count=None if counts is None else counts[number],
                )
        return list(self._topics.values())

    def messages(self, names: Collection[str]) -> Iterator[Message]:
        """Messages of some topics; an unreadable row gives a lost message with a fault."""
        wanted = [number for number, topic in self._topics.items() if topic.name in names]
        if not wanted:
            return
        marks = ",".join("?" * len(wanted))
        query = (
            f"SELECT id, topic_id, timestamp, data FROM messages WHERE id > ? "
            f"AND topic_id IN ({marks}) ORDER BY id"
        )
        with closing(self._connect()) as database:
            last, done = self._last_row(database), 0
            while True:
                try:
                    for row, number, time_ns, data in database.execute(query, (done, *wanted)):
                        yield self._message(number, time_ns, data)
                        done = row
                    return
                except sqlite3.Error as error:
                    if last is None:
                        problem = f"{self.path.name} ends behind row {done}: {error}"
                        yield Message(topic=None, time_ns=None, fault=problem)
                        return
                rows = range(done + 1, min(done + _ONE_BY_ONE, last) + 1)
                for row in rows:
                    yield from self._one(database, row, wanted)
                if not rows:
                    return
                done = rows[-1]

    def _one(self, database: sqlite3.Connection, row: int, wanted: list[int]) -> Iterator[Message]:
        """The message of one row, if its topic is wanted and the row is readable."""
        known = None
        try:
            # Topic and time are at the beginning of a row, which is often still readable.
            known = database.execute(
                "SELECT topic_id, timestamp FROM messages WHERE id = ?", (row,)
            ).fetchone()
            if known is None or known[0] not in wanted:
                return
            (data,) = database.execute("SELECT data FROM messages WHERE id = ?", (row,)).fetchone()
            yield self._message(known[0], known[1], data)
        except sqlite3.Error as error:
            topic, time_ns = None, None
            if known is not None:
                topic, time_ns = self._topics[known[0]], _whole(known[1])
            yield Message(topic=topic, time_ns=time_ns, fault=f"row {row} cannot be read: {error}")

    def _message(self, number: int, time_ns: object, data: object) -> Message:
        topic, recorded_ns = self._topics[number], _whole(time_ns)
        if not isinstance(data, bytes):
            return Message(topic=topic, time_ns=recorded_ns, fault="the row holds no message")
        return Message(topic=topic, time_ns=recorded_ns, data=data)

    @staticmethod
    def _last_row(database: sqlite3.Connection) -> int | None:
        try:
            return database.execute("SELECT max(id) FROM messages").fetchone()[0]
        except sqlite3.Error:
            return None

    @staticmethod
    def _definitions(database: sqlite3.Connection) -> dict[str, tuple[str, bool]]:
        """Definition of each type, and whether the language is IDL; empty for older bags."""
        try:
            rows = database.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            ).fetchall()
        except sqlite3.Error:
            return {}
        return {kind: (text, language == "ros2idl") for kind, language, text in rows}

    @staticmethod
    def _counts(database: sqlite3.Connection) -> Counter[int] | None:
        """Number of messages of each topic, counted row by row to limit memory."""
        try:
            return Counter(
                number for (number,) in database.execute("SELECT topic_id FROM messages")
            )
        except sqlite3.Error:
            return None

    def _connect(self) -> sqlite3.Connection:
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise InputError("expected a database of ROS 2 (sqlite3)", file=self.path)
        # Immutable, so that bags on read-only disks open, and no lock files are made. If the
        # recorder was killed, the last rows are in a log, which SQLite does not read if immutable.
        log = self.path.with_name(self.path.name + "-wal")
        rest = "" if log.exists() else "&immutable=1"
        address = f"file:{quote(str(self.path.absolute()))}?mode=ro{rest}"
        database = sqlite3.connect(address, uri=True, check_same_thread=False)
        database.text_factory = lambda data: data.decode(errors="replace")
        # Reads the rest of a file that is shorter than its header states; nothing is written.
        database.execute("PRAGMA writable_schema = ON")
        return database


def _whole(time_ns: object) -> int | None:
    return time_ns if isinstance(time_ns, int) else None
