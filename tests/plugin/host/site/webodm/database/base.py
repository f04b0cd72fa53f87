"""SQLite whose transactions wait for each other, as those of WebODM's PostgreSQL do.

SQLite begins one as a reader. Where it then writes and another is about to write, neither can go
on, so it fails at once, whatever the time it may wait: "database is locked". One that begins as a
writer waits before it has read anything. Django before 5.1 has no setting for that.
"""

from django.db.backends.sqlite3 import base


class DatabaseWrapper(base.DatabaseWrapper):
    """Begins transactions as writers."""

    def _start_transaction_under_autocommit(self):
        self.cursor().execute("BEGIN IMMEDIATE")
