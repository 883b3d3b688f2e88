"""Which tests of a file run only by hand: what takes long and shows what others show in part.

    @price.long
    def test_every_lamp(self):

ctest has an entry ROOM.NAME_full for a file with such tests, which runs all of it (label long). `full` says whether
that is what runs: other tests of the file then have more samples, or more cases."""
import os
import unittest

full = os.environ.get("KILN_TEST_FULL") is not None
long = unittest.skipIf(not full, "runs in the test of the same name with _full")
