"""Which tests of a file run only by hand: what takes long and shows what others show in part.

    @price.long
    def test_every_lamp(self):

ctest has an entry ROOM.NAME_full for a file with such tests, which runs all of it (label long)."""
import os
import unittest

long = unittest.skipIf(os.environ.get("KILN_TEST_FULL") is None, "runs in the test of the same name with _full")
