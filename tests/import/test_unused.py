"""What is in a file and not in a bake is named by info, check and bake, by kind and count; what KHR_node_visibility
hides is left out."""
import os

import importing


def said(path, *options):
    """All notes of `kiln info`, as one text."""
    answer = importing.info(path, *options)
    assert answer.code == 0, answer.err
    return "\n".join(note["text"] for note in answer.json()["notes"])


class Unused(importing.Case):
    def write(self, **more):
        return importing.write(self.folder(), "scene.gltf", importing.quad(**more))

    def test_lamps_of_unknown_extensions(self):
        """A lamp that is not read is a warning of every command, with its extension and its count."""
        path = self.write(extensionsUsed=["EXT_lights_ies", "EXT_lights_image_based", "ACME_lights_tube"],
                          extensions={"EXT_lights_ies": {"lights": [{"uri": "a.ies"}, {"uri": "b.ies"}]}},
                          nodes=[{"mesh": 0}] + [{"extensions": {"EXT_lights_ies": {"light": i}}} for i in (0, 1, 1)],
                          scenes=[{"nodes": [0, 1, 2, 3], "extensions": {"EXT_lights_image_based": {"light": 0}}}])
        words = ("EXT_lights_ies (3 nodes, 2 entries at the top of the file) is not read",
                 "the light that it describes", "EXT_lights_image_based (1 scene)",
                 "ACME_lights_tube (named in extensionsUsed only)")
        checked = importing.kiln("check", path)
        baked = importing.kiln("bake", path, "-o", os.path.join(self.folder(), "out"), "--lightmap-size", 16,
                               "--samples-probe", 0, "--no-preview")
        self.assertEqual((checked.code, baked.code), (0, 0), baked.err)
        for text in (said(path), checked.out, baked.err):
            for word in words:
                self.assertIn(word, text)
        self.assertIn("warning: import: EXT_lights_ies", checked.out)

    def test_kinds_and_counts(self):
        """Features of the specification, extensions of any place, also within others; extras are an application's."""
        inner = {"index": 0, "extensions": {"ACME_shift": {}}}
        path = self.write(
            nodes=[{"mesh": 0}, {"mesh": 0}, {"camera": 0}, {"extensions": {"MSFT_lod": {"ids": [1]}}}],
            scenes=[{"nodes": [0, 2, 3]}, {"nodes": [1]}],
            cameras=[{"type": "ACME_fisheye"}], animations=[{"channels": [], "samplers": []}] * 3,
            extensions={"KHR_materials_variants": {"variants": [{"name": "a"}, {"name": "b"}]},
                        "KHR_lights_punctual": {"lights": [{"type": "point"}]}},
            extras={"extensions": {"ACME_private": {}}},
            meshes=[{"primitives": [{"attributes": {"POSITION": 0, "COLOR_1": 0, "_WIND": 0}, "indices": 1},
                                    {"attributes": {"POSITION": 0}, "mode": 0}]}, {"primitives": []}],
            materials=[{"extensions": {"ACME_paint": {"paintTexture": inner}, "KHR_materials_sheen": {}}}] * 2)
        text = said(path)
        for word in ("3 animations", "1 further scenes", "1 nodes with a mesh, a light or a camera outside the scene",
                     "1 cameras of a kind", "1 primitives of points", "1 meshes on no node", "1 lights on no node",
                     "materials with ACME_paint", "2 materials with ACME_shift", "2 materials with KHR_materials_sheen",
                     "2 entries at the top of the file with KHR_materials_variants", "MSFT_lod (1 node)",
                     "1 vertex attributes COLOR_1", "1 vertex attributes _WIND"):
            self.assertIn(word, text)
        self.assertNotIn("ACME_private", text)
        self.assertNotIn("KHR_lights_punctual", text)

    def test_emission_that_counts_for_nothing(self):
        pixel = ("data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQ"
                 "AAAABJRU5ErkJggg==")
        unlit = {"emissiveFactor": [1, 1, 1], "extensions": {"KHR_materials_unlit": {}}}
        path = self.write(materials=[{"emissiveTexture": {"index": 0}}, unlit], images=[{"uri": pixel}],
                          textures=[{"source": 0}])
        self.assertIn("1 emission textures beside an emissiveFactor of 0; 1 emissions of unlit materials", said(path))

    def test_a_plain_scene_has_none(self):
        self.assertNotIn("in the file, but not in a bake", said(self.write(extensionsUsed=["KHR_texture_transform"])))

    def test_very_many_kinds(self):
        """Names are a file's own: what they make kiln say stays bounded."""
        nodes = [{"extensions": {f"ACME_{i}": {}}} for i in range(20000)] + [{"mesh": 0}]
        answer = importing.info(self.write(nodes=nodes, scenes=[{"nodes": [20000]}]))
        self.assertEqual(answer.code, 0, answer.err)
        self.assertLess(len(answer.out), 20000)
        self.assertIn("of other kinds", answer.out)
        self.assertLess(answer.seconds, importing.SECONDS)

    def test_invisible_nodes(self):
        """A node that is not visible hides itself and all below it, meshes and lights; true hides nothing."""
        hidden = {"KHR_node_visibility": {"visible": False}}
        lamp = {"KHR_lights_punctual": {"light": 0}}
        path = self.write(extensionsUsed=["KHR_node_visibility"], extensionsRequired=["KHR_node_visibility"],
                          extensions={"KHR_lights_punctual": {"lights": [{"type": "point"}]}},
                          nodes=[{"mesh": 0, "name": "seen", "extensions": {"KHR_node_visibility": {"visible": True}}},
                                 {"mesh": 0, "name": "a", "extensions": hidden, "children": [2, 3]},
                                 {"mesh": 0, "name": "b", "extensions": {"KHR_node_visibility": {"visible": True}}},
                                 {"extensions": lamp}, {"extensions": lamp, "name": "lit"}],
                          scenes=[{"nodes": [0, 1, 4]}])
        answer = importing.info(path).json()
        self.assertEqual([o["name"] for o in answer["objects"]], ["seen"])
        self.assertEqual([light["name"] for light in answer["lights"]], ["lit"])
        self.assertIn("3 invisible nodes", said(path))


if __name__ == "__main__":
    importing.main()
