"""Job files: errors name file and line, and nothing a file holds costs much time or memory."""
import os
import unittest

from kiln_cli import InOwnFolder, kiln


class JobFile(InOwnFolder):
    def answer(self, text, *arguments):
        path = os.path.join(self.folder, "job.yaml")
        with open(path, "wb") as file:
            file.write(text if isinstance(text, bytes) else text.encode())
        answer = kiln("bake", "job.yaml", *arguments, folder=self.folder)
        self.assertLess(answer.seconds, 5)
        return answer

    def refused(self, pattern, text, code=65):
        answer = self.answer(text)
        self.assertEqual(answer.code, code, answer.err)
        self.assertRegex(answer.sentence(), pattern)

    def test_errors_name_file_and_line(self):
        for pattern, text in {
            r"^job.yaml:3: unknown key 'smaples-direct'.*'samples-direct'": "# a comment\nscene: a.glb\n"
                                                                            "smaples-direct: 4\n",
            r"^job.yaml:1: unknown key 'scne'.*'scene'": "scne: a.glb\n",
            r"^job.yaml:2: unknown key 'samples_direct'.*'samples-direct'": "scene: a.glb\nsamples_direct: 4\n",
            r"^job.yaml:2: a job file has no key 'camera'": "scene: a.glb\ncamera: main\n",
            r"^job.yaml:4: the key 'seed' stands twice": "scene: a.glb\nseed: 1\n\nseed: 2\n",
            r"^job.yaml:2: the key 'scene' stands twice": "scene: a.glb\nscene: b.glb\n",
            r"^job.yaml:2: threads: 'many' is not a whole number": "scene: a.glb\nthreads: many\n",
            r"^job.yaml:2: threads: 0 is out of range.*1 to 4096": "scene: a.glb\nthreads: 0\n",
            r"^job.yaml:2: threads: \"4\" is text": "scene: a.glb\nthreads: \"4\"\n",
            r"^job.yaml:2: threads is a list": "scene: a.glb\nthreads: [4]\n",
            r"^job.yaml:1: scene is a mapping": "scene: {file: a.glb}\n",
            r"^job.yaml:2: the key 'threads' has no value": "scene: a.glb\nthreads:\n",
            r"^job.yaml:2: the key 'threads' has no value": "scene: a.glb\nthreads: ~\n",
            r"^job.yaml:2: half: 'yes' is neither true nor false": "scene: a.glb\nhalf: yes\n",
            r"^job.yaml: the key 'scene' is missing": "seed: 4\n",
            r"^job.yaml:1: the job file is empty": "",
            r"^job.yaml:1: a job file is one mapping": "- scene\n- a.glb\n",
            r"^job.yaml:2: is not YAML": "scene: a.glb\n\tseed: 1\n",
            r"^job.yaml:2: a second document": "scene: a.glb\n---\nscene: b.glb\n",
            r"^job.yaml:1: scene has a NUL": "scene: \"a\\0.glb\"\n",
            r"^job.yaml:2: method: .*'photons'": "scene: a.glb\nmethod: photons\n",
        }.items():
            self.refused(pattern, text)
        self.refused(r"^job.yaml:2: is not text in UTF-8", b"scene: a.glb\n# \xff\xfe\n")
        self.refused(r"^job.yaml:2: backend: .*'cuda'", "scene: a.glb\nbackend: cuda\n", code=69)

    def test_bombs(self):
        laughs = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
            f"{chr(98 + i)}: &{chr(98 + i)} [{','.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(12))
        self.refused(r"^job.yaml:1: ", laughs)
        self.refused(r"^job.yaml:2: seed is an alias", "scene: &s a.glb\nseed: *s\n")
        self.refused(r"^job.yaml:1: ", "scene: " + "[" * 500000)
        self.refused(r"^job.yaml:1: ", "{" * 500000)
        self.refused(r"too many for a job file", b"#" * (1 << 20) + b"\n")

    def test_things_that_are_no_files(self):
        os.mkdir(os.path.join(self.folder, "folder.yaml"))
        os.symlink("/dev/zero", os.path.join(self.folder, "zero.yaml"))
        os.mkfifo(os.path.join(self.folder, "pipe.yaml"))
        for name in ("folder.yaml", "zero.yaml", "pipe.yaml"):
            answer = kiln("bake", name, folder=self.folder, timeout=5)
            self.assertEqual(answer.code, 65)
            self.assertRegex(answer.sentence(), f"^'{name}' is not a plain file")

    def test_paths_are_relative_to_the_job_file(self):
        os.mkdir(os.path.join(self.folder, "deep"))
        with open(os.path.join(self.folder, "deep", "job.yaml"), "w") as file:
            file.write("scene: sub/a.glb\n")
        answer = kiln("bake", "deep/job.yaml", folder=self.folder)
        self.assertEqual(answer.code, 66)
        self.assertIn(" deep/sub/a.glb: ", answer.sentence())


if __name__ == "__main__":
    unittest.main()
