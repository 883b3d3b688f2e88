"""What the program can not do, for it does not refer to it: start a shell, or another program by a search of PATH that
replaces it; listen, or talk to a network itself (MPI does)."""
import os
import shutil
import subprocess
import unittest

SHELLS = {'system', 'popen', 'wordexp', 'execl', 'execlp', 'execle', 'execv', 'execve', 'execvp', 'execvpe', 'fexecve',
          'dlopen', 'mktemp', 'tmpnam', 'tempnam', 'gets'}
NETWORK = {'socket', 'connect', 'bind', 'listen', 'accept', 'accept4', 'sendto', 'recvfrom', 'getaddrinfo',
           'gethostbyname'}


class Calls(unittest.TestCase):
    def test_no_shell_and_no_network(self):
        if shutil.which('nm') is None:
            self.skipTest('nm is not installed.')
        listing = subprocess.run(['nm', '-D', '--undefined-only', os.environ['KILN']], capture_output=True, text=True,
                                 check=True).stdout
        names = {row.split()[-1].split('@')[0] for row in listing.splitlines() if row.strip()}
        self.assertIn('posix_spawn', names)  # so that the listing is one
        self.assertEqual(names & (SHELLS | NETWORK), set())


if __name__ == '__main__':
    unittest.main()
