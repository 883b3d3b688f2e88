"""Every malformed scene of ../shared/scenes/own/bad is answered with exit code 65 and a sentence; so are the files of
the Khronos validator's and Assimp's collections, as far as kiln does not take them: never a crash, never long, never
much memory."""
import glob
import json
import os
import sys

import importing

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "common"))
import price  # noqa: E402

OWN = importing.need_shared("own", "bad")


class Bad(importing.Case):
    def test_own(self):
        with open(os.path.join(OWN, "index.json")) as file:
            names = sorted(json.load(file))
        self.assertGreater(len(names), 60)
        for name in names:
            with self.subTest(name):
                self.refused(os.path.join(OWN, name))

    def test_sentences_name_the_place(self):
        for name, words in {
            "accessor_count_negative.glb": ["accessors[0].count", "-1"],
            "material_index_oob.glb": ["meshes[0].primitives[0].material", "99"],
            "node_cycle_3.glb": ["cycle"],
            "buffer_uri_path_traversal.gltf": ["buffers[0].uri", "../"],
            "position_nan.glb": ["nan"],
            "bad_index.obj": ["line 4", "9"],
            "normals_zero.glb": ["normals are zero"],
        }.items():
            with self.subTest(name):
                self.refused(os.path.join(OWN, name), words)

    def test_collections_never_crash(self):
        """Their files are right, wrong, or beyond kiln: either way an answer, not an accident. Every third of them."""
        self.never_crash(slice(None, None, 3))

    @price.long
    def test_whole_collections_never_crash(self):
        self.never_crash(slice(None))

    def never_crash(self, some):
        files = [f for kind in ("glb", "gltf", "obj") for f in
                 glob.glob(os.path.join(importing.SHARED, "third_party", "*", "**", "*." + kind), recursive=True)]
        files = sorted(f for f in files if os.sep + "noncommercial" + os.sep not in f)[some]
        if not files:
            self.skipTest("../shared/scenes/third_party is not here")
        codes = {}
        for path in files:
            answer = importing.kiln("info", path, "--lightmap-max", 64)
            with self.subTest(path):
                self.assertIn(answer.code, (0, 65), answer.err)
                self.assertNotIn("importer died", answer.err)
                # what is taken also has its surface points checked, and some scenes pile up hundreds of equal boxes
                self.assertLess(answer.seconds, importing.SECONDS if answer.code == 65 else 60)
                codes[answer.code] = codes.get(answer.code, 0) + 1
        print(f"{len(files)} files: {codes.get(0, 0)} taken, {codes.get(65, 0)} refused")


if __name__ == "__main__":
    importing.main()
