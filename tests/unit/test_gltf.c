/* Tests of the glTF reader: small files are made here, read in this process, and their values checked in the builder.
 */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/import/read.h"
#include "worker/base/memory.h"
#include "worker/scene/gloss.h"

/* Content of "scene.bin": a quad in the plane z = 0 as floats, and what the tests need besides. */
static const struct {
    float positions[4][3];    /* byte 0 */
    float normals[4][3];      /* 48 */
    float uv[4][2];           /* 96 */
    uint16_t indices[6];      /* 128 */
    uint8_t bytes[4];         /* 140: sparse indices 1 and 3 */
    float replaced[2][3];     /* 144 */
    uint8_t colors[4][4];     /* 168 */
    float translations[2][3]; /* 184 */
    float zero_normals[4][3]; /* 208 */
    float stray[4][3];        /* 256: a zero-area triangle in an otherwise good quad */
} binary = {
    .positions = {{0, 0, 0}, {2, 0, 0}, {2, 1, 0}, {0, 1, 0}},
    .normals = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}},
    .uv = {{0, 0}, {1, 0}, {1, 1}, {0, 1}},
    .indices = {0, 1, 2, 0, 2, 3},
    .bytes = {1, 3, 0, 0},
    .replaced = {{5, 0, 0}, {0, 7, 0}},
    .colors = {{255, 0, 51, 255}, {255, 0, 51, 255}, {255, 0, 51, 255}, {255, 0, 51, 255}},
    .translations = {{10, 0, 0}, {0, 20, 0}},
    .stray = {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {0, 3, 0}},
};

#define VIEWS                                                                                                          \
    "\"buffers\":[{\"uri\":\"scene%2Ebin\",\"byteLength\":304}],\"bufferViews\":["                                     \
    "{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,\"byteLength\":48},{\"buffer\":0,"               \
    "\"byteOffset\":96,\"byteLength\":32},"                                                                            \
    "{\"buffer\":0,\"byteOffset\":128,\"byteLength\":12},{\"buffer\":0,\"byteOffset\":140,\"byteLength\":4},{"         \
    "\"buffer\":0,\"byteOffset\":144,\"byteLength\":24},"                                                              \
    "{\"buffer\":0,\"byteOffset\":168,\"byteLength\":16},{\"buffer\":0,\"byteOffset\":184,\"byteLength\":24},{"        \
    "\"buffer\":0,\"byteOffset\":208,\"byteLength\":48},"                                                              \
    "{\"buffer\":0,\"byteOffset\":256,\"byteLength\":48}]"
#define ACCESSORS(more)                                                                                                \
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"},{\"bufferView\":1,"        \
    "\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"},"                                                           \
    "{\"bufferView\":2,\"componentType\":5126,\"count\":4,\"type\":\"VEC2\"},{\"bufferView\":3,\"componentType\":"     \
    "5123,\"count\":6,\"type\":\"SCALAR\"}" more "]"
#define HEAD "{\"asset\":{\"version\":\"2.0\"}," VIEWS ","
#define QUAD                                                                                                           \
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":1,\"TEXCOORD_1\":2},\"indices\":3}]}]"
#define ONE_NODE "\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"mesh\":0}]"

struct fixture {
    char folder[64], scene[96], data[96];
    struct kiln_builder *builder;
    struct kiln_error error;
};

static int set_up(void **state)
{
    struct fixture *f = calloc(1, sizeof *f);
    (void)snprintf(f->folder, sizeof f->folder, "/tmp/kiln-test-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    (void)snprintf(f->scene, sizeof f->scene, "%s/scene.gltf", f->folder);
    (void)snprintf(f->data, sizeof f->data, "%s/scene.bin", f->folder);
    FILE *file = fopen(f->data, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(&binary, sizeof binary, 1, file), 1);
    (void)fclose(file);
    *state = f;
    return 0;
}

static int tear_down(void **state)
{
    struct fixture *f = *state;
    kiln_builder_destroy(&f->builder);
    (void)unlink(f->scene);
    (void)unlink(f->data);
    (void)rmdir(f->folder);
    free(f);
    return 0;
}

static int read_text(struct fixture *f, const char *text)
{
    FILE *file = fopen(f->scene, "wb");
    assert_non_null(file);
    (void)fputs(text, file);
    (void)fclose(file);
    kiln_builder_destroy(&f->builder);
    assert_int_equal(kiln_builder_create(&f->builder, NULL), KILN_OK);
    const struct kiln_import_params params = {.path = f->scene, .environment_scale = 1.0};
    f->error.message[0] = '\0';
    return kiln_import_read(&params, NULL, f->builder, &f->error);
}

static void accepted(struct fixture *f, const char *text)
{
    if (read_text(f, text) != KILN_OK)
        fail_msg("%s", f->error.message);
}

static void refused(struct fixture *f, const char *text, const char *word)
{
    if (read_text(f, text) != KILN_BAD_INPUT)
        fail_msg("accepted, or refused otherwise: %s", f->error.message);
    if (strstr(f->error.message, word) == NULL || strstr(f->error.message, "scene.gltf") == NULL)
        fail_msg("'%s' does not name the file and '%s'", f->error.message, word);
}

#define DATA(type, section) KILN_BUILDER_DATA(f->builder, const type, section)
#define COUNT(section) f->builder->sections[section].count

static void near(double a, double b)
{
    if (!(fabs(a - b) <= 1e-6 * fmax(1.0, fabs(b))))
        fail_msg("%.9g is not %.9g", a, b);
}

static void a_quad_comes_through(void **state)
{
    struct fixture *f = *state;
    accepted(f, HEAD ACCESSORS("") "," QUAD "," ONE_NODE "}");
    assert_int_equal(COUNT(KILN_SECTION_TRIANGLES), 2);
    assert_int_equal(COUNT(KILN_SECTION_POSITIONS), 4);
    assert_memory_equal(DATA(float, KILN_SECTION_POSITIONS), binary.positions, sizeof binary.positions);
    assert_memory_equal(DATA(float, KILN_SECTION_TEXCOORD_LIGHTMAP), binary.uv, sizeof binary.uv);
    assert_int_equal(f->builder->mesh_has_lightmap_uv[0], 1);
    assert_int_equal(DATA(struct kiln_mesh, KILN_SECTION_MESHES)[0].flags, 0);
    assert_int_equal(COUNT(KILN_SECTION_SOURCES), 2);
    near((double)DATA(struct kiln_material, KILN_SECTION_MATERIALS)[0].base_color[0], 0.8); /* no material: grey */
    assert_int_equal(COUNT(KILN_SECTION_ENVIRONMENT), 1);
}

static void nodes_multiply_and_names_are_unique(void **state)
{
    struct fixture *f = *state;
    accepted(f, HEAD ACCESSORS("") "," QUAD ",\"scenes\":[{\"nodes\":[1]}],\"nodes\":["
                                   "{\"mesh\":0,\"name\":\"a/b\",\"translation\":[0,0,5]},"
                                   "{\"rotation\":[0,0,0.70710678118654752,0.70710678118654752],\"translation\":[1,2,3]"
                                   ",\"scale\":[2,2,2],\"children\":[0,2,3]},"
                                   "{\"mesh\":0,\"name\":\"A?B\",\"scale\":[-1,1,1]},"
                                   "{\"mesh\":0,\"matrix\":[1,0,0,0, 0,1,0,0, 0,0,1,0, 7,8,9,1]},"
                                   "{\"mesh\":0,\"name\":\"elsewhere\"}]}");
    const struct kiln_object *o = DATA(struct kiln_object, KILN_SECTION_OBJECTS);
    const char *strings = DATA(char, KILN_SECTION_STRINGS);
    assert_int_equal(COUNT(KILN_SECTION_OBJECTS), 3);
    assert_string_equal(strings + o[0].name, "a_b");
    assert_string_equal(strings + o[0].original_name, "a/b");
    assert_string_equal(strings + o[1].name, "A_B_2"); /* unique also where letters of both cases are one */
    assert_string_equal(strings + o[2].name, "node_3");
    /* parent: a quarter turn about z, doubled, then moved: (x, y, z) -> (1 - 2 y, 2 + 2 x, 3 + 2 z) */
    near(o[0].transform[3], 1);
    near(o[0].transform[11], 13);
    near(o[0].transform[1], -2);
    near(o[0].transform[4], 2);
    assert_int_equal(o[0].flipped, 0);
    assert_int_equal(o[1].flipped, 1);
    near(o[2].transform[3], 1 - 2 * 8);
    near(o[2].transform[7], 2 + 2 * 7);
    near(o[2].transform[11], 3 + 2 * 9);
    assert_int_equal(COUNT(KILN_SECTION_MESHES), 1);
}

static void strips_and_fans_keep_their_winding(void **state)
{
    struct fixture *f = *state;
#define DRAWN_AS(mode)                                                                                                 \
    HEAD ACCESSORS("") ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"mode\":" mode                 \
                       "}]}]," ONE_NODE "}"
    static const char *const texts[2] = {DRAWN_AS("5"), DRAWN_AS("6")};
    for (int fan = 0; fan < 2; fan++) {
        accepted(f, texts[fan]);
        assert_int_equal(COUNT(KILN_SECTION_TRIANGLES), 2);
        const struct kiln_vec3 *n = DATA(struct kiln_vec3, KILN_SECTION_NORMALS);
        const uint32_t *t = DATA(uint32_t, KILN_SECTION_TRIANGLES);
        /* flat normals from the winding; as a strip the quad's corners cross over, and its second triangle looks back
         */
        near((double)n[t[0]].z, 1.0);
        near((double)n[t[3]].z, fan ? 1.0 : -1.0);
    }
}

static void winding_decides_and_normals_follow(void **state)
{
    struct fixture *f = *state;
    /* indices reversed by using the zero normals (refused) and the good ones turned (kept and turned) */
    refused(
        f,
        HEAD ACCESSORS(
            ",{\"bufferView\":8,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}") ","
                                                                                        "\"meshes\":[{\"primitives\":[{"
                                                                                        "\"attributes\":{\"POSITION\":"
                                                                                        "0,\"NORMAL\":4},\"indices\":3}"
                                                                                        "]}]," ONE_NODE "}",
        "normals are zero");
    /* positions as normals: lean (0,0,0) (2,0,0) (2,1,0) (0,1,0) lie in the plane: replaced by the geometric one */
    accepted(f, HEAD ACCESSORS("") ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"NORMAL\":0},"
                                   "\"indices\":3}]}]," ONE_NODE "}");
    const struct kiln_vec3 *n = DATA(struct kiln_vec3, KILN_SECTION_NORMALS);
    for (size_t v = 0; v < COUNT(KILN_SECTION_NORMALS); v++)
        near((double)n[v].z, 1.0);
    assert_int_equal(DATA(struct kiln_mesh, KILN_SECTION_MESHES)[0].flags & KILN_MESH_SMOOTH, 0);
}

static void triangles_without_area_are_left_out(void **state)
{
    struct fixture *f = *state;
    accepted(
        f,
        HEAD ACCESSORS(
            ",{\"bufferView\":9,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}") ","
                                                                                        "\"meshes\":[{\"primitives\":[{"
                                                                                        "\"attributes\":{\"POSITION\":"
                                                                                        "4},\"indices\":3}]}]," ONE_NODE
                                                                                        "}");
    assert_int_equal(COUNT(KILN_SECTION_TRIANGLES), 1);
    assert_int_equal(COUNT(KILN_SECTION_POSITIONS), 3);
    const struct kiln_note *notes = DATA(struct kiln_note, KILN_SECTION_NOTES);
    assert_non_null(strstr(DATA(char, KILN_SECTION_STRINGS) + notes[0].text, "1 triangles without area"));
}

static void sparse_values_replace(void **state)
{
    struct fixture *f = *state;
#define SPARSE                                                                                                         \
    "\"sparse\":{\"count\":2,\"indices\":{\"bufferView\":4,\"componentType\":5121},\"values\":{\"bufferView\":5}}"
    accepted(f,
             HEAD ACCESSORS(
                 ",{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"," SPARSE
                 "}") ","
                      "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":4},\"indices\":3}]}]," ONE_NODE "}");
    float expected[4][3];
    memcpy(expected, binary.positions, sizeof expected);
    memcpy(expected[1], binary.replaced[0], 12);
    memcpy(expected[3], binary.replaced[1], 12);
    assert_memory_equal(DATA(float, KILN_SECTION_POSITIONS), expected, sizeof expected);
    /* without a buffer view the rest is zero, whatever the count; and indices that do not ascend are refused */
    refused(f,
            HEAD ACCESSORS(",{\"componentType\":5126,\"count\":4000000000,\"type\":\"VEC3\"," SPARSE
                           "}") ","
                                "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":4},\"mode\":5}]}]," ONE_NODE
                                "}",
            "more than files of its size can hold");
    refused(f,
            HEAD ACCESSORS(",{\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"," SPARSE
                           "}") ","
                                "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":4}}]}]," ONE_NODE "}",
            "sparse");
}

static void materials(void **state)
{
    struct fixture *f = *state;
    accepted(f, HEAD ACCESSORS("") ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":3,"
                                   "\"material\":1}]}]," ONE_NODE
                                   ",\"materials\":[{},{\"name\":\"lamp\",\"doubleSided\":true,\"alphaMode\":\"MASK\","
                                   "\"alphaCutoff\":0.25,\"emissiveFactor\":[1,0.5,0],"
                                   "\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.1,0.2,0.3,0.4],\"metallicFactor\":"
                                   "0.5,\"roughnessFactor\":0.75},"
                                   "\"extensions\":{\"KHR_materials_emissive_strength\":{\"emissiveStrength\":12}}}]}");
    const struct kiln_material *m = DATA(struct kiln_material, KILN_SECTION_MATERIALS);
    near((double)m[0].metallic, 1.0); /* the specification's defaults */
    near((double)m[0].base_color[2], 1.0);
    near((double)m[1].emission[0], 12.0);
    near((double)m[1].emission[1], 6.0);
    near((double)m[1].base_color[3], 0.4);
    near((double)m[1].metallic, 0.5);
    near((double)m[1].alpha_cutoff, 0.25);
    assert_int_equal(m[1].alpha_mode, KILN_ALPHA_MASK);
    assert_int_equal(m[1].double_sided, 1);
    assert_int_equal(DATA(uint32_t, KILN_SECTION_TRIANGLE_MATERIALS)[0], 1);
    refused(f, HEAD ACCESSORS("") ",\"materials\":[{\"emissiveFactor\":[0,-1,0]}]}", "emissiveFactor");
    refused(f, HEAD ACCESSORS("") ",\"materials\":[{\"pbrMetallicRoughness\":{\"metallicFactor\":2}}]}",
            "metallicFactor");
    refused(f, HEAD ACCESSORS("") ",\"materials\":[{\"alphaMode\":\"SOMETIMES\"}]}", "alphaMode");
}

static void glass(void **state)
{
    struct fixture *f = *state;
    accepted(f,
             HEAD ACCESSORS(
                 "") ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":3,\"material\":0}]}]"
                     "," ONE_NODE
                     ",\"materials\":[{\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":0.75}}},"
                     "{\"extensions\":{\"KHR_materials_transmission\":{}}},{},"
                     "{\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":1},\"KHR_materials_"
                     "volume\":{\"thicknessFactor\":0.5}}}]}");
    const struct kiln_material *m = DATA(struct kiln_material, KILN_SECTION_MATERIALS);
    near((double)m[0].transmission, 0.75);
    near((double)m[1].transmission, 0.0); /* the specification's default */
    near((double)m[2].transmission, 0.0);
    near((double)m[3].transmission, 1.0);
    assert_int_equal(m[0].transmission_texture, KILN_NONE);
    refused(f,
            HEAD ACCESSORS(
                "") ",\"materials\":[{\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":1.5}}}]}",
            "transmissionFactor");
}

/* A 1 x 1 PNG, embedded. */
#define PIXEL                                                                                                          \
    "\"images\":[{\"uri\":\"data:image/png;base64,"                                                                    \
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg==\"}]"

/* A PNG of two pixels, embedded: red, and nearly so. */
#define TWO_PIXELS                                                                                                     \
    "\"images\":[{\"uri\":\"data:image/png;base64,"                                                                    \
    "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAIAAAB7QOjdAAAAD0lEQVR4nGP4z8Dwn4ERAAj/AgBM/rJyAAAAAElFTkSuQmCC\"}]"

/* A transmission texture at the base colour's coordinates, or alone, is looked up; at others it counts as its mean.
 * Both pixels are red, and not of one colour, which would be a factor instead. */
static void glass_has_a_texture(void **state)
{
    struct fixture *f = *state;
    accepted(f,
             HEAD ACCESSORS("") "," TWO_PIXELS ",\"textures\":[{\"source\":0}],\"materials\":["
                                "{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}},\"extensions\":{\"KHR_"
                                "materials_transmission\":"
                                "{\"transmissionFactor\":0.5,\"transmissionTexture\":{\"index\":0}}}},"
                                "{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}},\"extensions\":{\"KHR_"
                                "materials_transmission\":"
                                "{\"transmissionFactor\":0.5,\"transmissionTexture\":{\"index\":0,\"texCoord\":1}}}},"
                                "{\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":0.5,"
                                "\"transmissionTexture\":{\"index\":0,\"texCoord\":1}}}}],"
                                "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_1\":2},"
                                "\"indices\":3,\"material\":2}]}]," ONE_NODE "}");
    const struct kiln_material *m = DATA(struct kiln_material, KILN_SECTION_MATERIALS);
    const struct kiln_texture *t = DATA(struct kiln_texture, KILN_SECTION_TEXTURES);
    assert_true(m[0].transmission_texture != KILN_NONE && m[0].base_color_texture != m[0].transmission_texture);
    assert_int_equal(t[m[0].transmission_texture].srgb, 0);
    assert_int_equal(t[m[0].base_color_texture].srgb, 1);
    assert_int_equal(m[1].transmission_texture, KILN_NONE);
    near((double)m[1].transmission, 0.5); /* x 1: the red of the pixels */
    assert_int_equal(m[2].transmission_texture, m[0].transmission_texture);
    assert_int_equal(m[2].base_color_texture, KILN_NONE);
    const struct kiln_vec2 *uv = DATA(struct kiln_vec2, KILN_SECTION_TEXCOORD_BASE);
    bool moved = false;
    for (int v = 0; v < 4; v++)
        moved = moved || uv[v].x != 0.0f || uv[v].y != 0.0f;
    assert_true(moved); /* they are TEXCOORD_1's */
}

static void texture_transforms_follow_the_specification(void **state)
{
    struct fixture *f = *state;
    /* The example of KHR_texture_transform: the lower left quarter, turned; and texCoord in it overrides the other. */
    accepted(f,
             HEAD ACCESSORS("") "," PIXEL ",\"textures\":[{\"source\":0,\"sampler\":0}],\"samplers\":[{\"wrapS\":33071,"
                                "\"wrapT\":33648,\"magFilter\":9728}],"
                                "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0,"
                                "\"texCoord\":0,\"extensions\":{\"KHR_texture_transform\":"
                                "{\"offset\":[0,1],\"rotation\":1.57079632679,\"scale\":[0.5,0.5],\"texCoord\":1}}}}}],"
                                "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_1\":2},"
                                "\"indices\":3,\"material\":0}]}]," ONE_NODE "}");
    const struct kiln_vec2 *uv = DATA(struct kiln_vec2, KILN_SECTION_TEXCOORD_BASE);
    static const double expected[4][2] = {{0, 1}, {0, 0.5}, {0.5, 0.5}, {0.5, 1}};
    for (int v = 0; v < 4; v++) {
        near((double)uv[v].x, expected[v][0]);
        near((double)uv[v].y, expected[v][1]);
    }
    const struct kiln_texture *t = DATA(struct kiln_texture, KILN_SECTION_TEXTURES);
    assert_int_equal(t->wrap_u, KILN_WRAP_CLAMP);
    assert_int_equal(t->wrap_v, KILN_WRAP_MIRROR);
    assert_int_equal(t->nearest, 1);
    assert_int_equal(t->srgb, 1);
    assert_int_equal(t->width, 1);
    assert_int_equal(DATA(struct kiln_mesh, KILN_SECTION_MESHES)[0].flags & KILN_MESH_HAS_EMISSION_UV, 0);
}

/* A normal map has a linear texture and coordinates of its own. A vertex whose material has none repeats the base
 * colour's. The pixel is red, no normal map; 1 x 1 pixel of (128, 128, 255) is one. */
#define FLAT_PIXEL                                                                                                     \
    "{\"uri\":\"data:image/png;base64,"                                                                                \
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGNoaPgPAAODAgAApfuJAAAAAElFTkSuQmCC\"}"
static void normal_maps_are_read(void **state)
{
    struct fixture *f = *state;
    accepted(f, HEAD ACCESSORS("") ",\"images\":[" FLAT_PIXEL "],\"textures\":[{\"source\":0}],\"materials\":["
                                   "{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}}},"
                                   "{\"normalTexture\":{\"index\":0,\"scale\":0}},"
                                   "{\"normalTexture\":{\"index\":0,\"scale\":0.5,\"texCoord\":1,\"extensions\":{"
                                   "\"KHR_texture_transform\":{\"offset\":[3,4]}}}}],"
                                   "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_0\":2},"
                                   "\"indices\":3,\"material\":0},{\"attributes\":{\"POSITION\":0,\"TEXCOORD_1\":2},"
                                   "\"indices\":3,\"material\":2}]}]," ONE_NODE "}");
    const struct kiln_normal_map *maps = DATA(struct kiln_normal_map, KILN_SECTION_NORMAL_MAPS);
    const struct kiln_texture *t = DATA(struct kiln_texture, KILN_SECTION_TEXTURES);
    const struct kiln_vec2 *uv = DATA(struct kiln_vec2, KILN_SECTION_TEXCOORD_NORMAL),
                           *base = DATA(struct kiln_vec2, KILN_SECTION_TEXCOORD_BASE);
    assert_int_equal(f->builder->sections[KILN_SECTION_NORMAL_MAPS].count, 1); /* not the one whose scale is 0 */
    assert_int_equal(maps->material, 2);
    near((double)maps->scale, 0.5);
    assert_int_equal(t[maps->texture].srgb, 0);
    assert_int_equal(f->builder->sections[KILN_SECTION_TEXCOORD_NORMAL].count, 8);
    for (int v = 0; v < 4; v++) {
        assert_memory_equal(&uv[v], &base[v], sizeof *uv);
        near((double)uv[4 + v].x, (double)base[v].x + 3);
        near((double)uv[4 + v].y, (double)base[v].y + 4);
        assert_true(base[4 + v].x == 0.0f && base[4 + v].y == 0.0f); /* no texture of the bake's uses them */
    }
}

/* ---- gloss ---- */

#define MATERIALS(list)                                                                                                \
    HEAD ACCESSORS("") ",\"images\":[" FLAT_PIXEL "],\"textures\":[{\"source\":0}],\"materials\":[" list "]"
#define DULL "\"pbrMetallicRoughness\":{\"metallicFactor\":0,\"roughnessFactor\":0.8}"
#define EXTENSION(name, body) "{" DULL ",\"extensions\":{\"KHR_materials_" name "\":" body "}}"

/* A material as diffuse as glTF allows leaves no trace. Any other has a record, and keeps its order. */
static void only_what_says_more_has_gloss(void **state)
{
    struct fixture *f = *state;
    accepted(
        f,
        MATERIALS(
            "{" DULL "}," EXTENSION("ior", "{\"ior\":1.5}") ","
            /* none of these matters without its factor: a body that lets nothing in, a coat of nothing */
            EXTENSION("volume", "{\"thicknessFactor\":2}") "," EXTENSION(
                "clearcoat",
                "{\"clearcoatRoughnessFactor\""
                ":0.3,\"clearcoatTexture\":{"
                "\"index\":0}}") "," EXTENSION("anisotropy",
                                               "{\"anisotropyRotation\":1}") "," EXTENSION("dispersion",
                                                                                           "{\"dispersion\":1}")) "}");
    assert_int_equal(COUNT(KILN_SECTION_GLOSS), 0);
    assert_int_equal(COUNT(KILN_SECTION_TEXTURES), 0);
    accepted(f, MATERIALS("{},{" DULL
                          "},{\"pbrMetallicRoughness\":{\"metallicFactor\":0,\"roughnessFactor\":0.25}}," EXTENSION(
                              "ior", "{\"ior\":1.4}")) "}");
    const struct kiln_gloss *g = DATA(struct kiln_gloss, KILN_SECTION_GLOSS);
    assert_int_equal(COUNT(KILN_SECTION_GLOSS), 3);
    assert_int_equal(g[0].material, 0);
    near((double)g[0].metallic, 1.0); /* the specification's defaults */
    near((double)g[0].roughness, 1.0);
    assert_int_equal(g[1].material, 2);
    near((double)g[1].mean_roughness, 0.25);
    assert_int_equal(g[2].material, 3);
    near((double)g[2].ior, 1.4);
    for (size_t i = 0; i < 3; i++)
        assert_null(kiln_gloss_fault(&g[i], 4, 0));
}

static void gloss_has_its_numbers(void **state)
{
    struct fixture *f = *state;
    accepted(f,
             MATERIALS(
                 "{" DULL ",\"extensions\":{\"KHR_materials_ior\":{\"ior\":1.33},"
                 "\"KHR_materials_specular\":{\"specularFactor\":0.5,\"specularColorFactor\":[1,2,3]},"
                 "\"KHR_materials_transmission\":{\"transmissionFactor\":0.75},"
                 "\"KHR_materials_volume\":{\"thicknessFactor\":0.1,\"attenuationDistance\":0.2,"
                 "\"attenuationColor\":[0.3,0.4,0.5]},\"KHR_materials_dispersion\":{\"dispersion\":0.6},"
                 "\"KHR_materials_clearcoat\":{\"clearcoatFactor\":0.7,\"clearcoatRoughnessFactor\":0.8},"
                 "\"KHR_materials_anisotropy\":{\"anisotropyStrength\":0.9,\"anisotropyRotation\":-2}}}," EXTENSION(
                     "ior", "{\"ior\":0}") ","
                                           "{" DULL
                                           ",\"extensions\":{\"KHR_materials_transmission\":{\"transmissionFactor\":1},"
                                           "\"KHR_materials_volume\":{\"thicknessFactor\":1,\"attenuationDistance\":3."
                                           "4e38}}}") "}");
    const struct kiln_gloss *g = DATA(struct kiln_gloss, KILN_SECTION_GLOSS);
    assert_int_equal(COUNT(KILN_SECTION_GLOSS), 3);
    assert_int_equal(g->model, KILN_GLOSS_METALLIC_ROUGHNESS);
    assert_int_equal(g->flags, KILN_GLOSS_VOLUME);
    const struct {
        float is;
        double wanted;
    } numbers[] = {{g->metallic, 0.0},
                   {g->roughness, 0.8},
                   {g->ior, 1.33},
                   {g->specular, 0.5},
                   {g->specular_color[0], 1.0},
                   {g->specular_color[2], 3.0},
                   {g->transmission, 0.75},
                   {g->thickness, 0.1},
                   {g->attenuation_distance, 0.2},
                   {g->attenuation_color[1], 0.4},
                   {g->dispersion, 0.6},
                   {g->clearcoat, 0.7},
                   {g->clearcoat_roughness, 0.8},
                   {g->anisotropy, 0.9},
                   {g->anisotropy_rotation, -2.0},
                   {g[1].ior, 0.0},
                   {g[2].attenuation_distance, 0.0}}; /* the largest float: it absorbs nothing */
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++)
        near((double)numbers[i].is, numbers[i].wanted);
    for (int i = 0; i < KILN_GLOSS_USES; i++)
        assert_int_equal(g->textures[i].texture, KILN_NONE);
}

/* One image serves several uses and is stored once for linear and once for sRGB-coded colours. Each use has its own
 * transform; one of another set is its mean. */
static void gloss_has_textures(void **state)
{
    struct fixture *f = *state;
    accepted(
        f,
        MATERIALS("{\"pbrMetallicRoughness\":{\"metallicRoughnessTexture\":{\"index\":0,\"texCoord\":1,"
                  "\"extensions\":{\"KHR_texture_transform\":{\"offset\":[0.25,0.5],\"scale\":[2,3]}}}},"
                  "\"extensions\":{\"KHR_materials_specular\":{"
                  "\"specularColorTexture\":{\"index\":0,\"texCoord\":1},"
                  "\"specularTexture\":{\"index\":0,\"texCoord\":1}},"
                  "\"KHR_materials_clearcoat\":{\"clearcoatFactor\":1,\"clearcoatRoughnessFactor\":1,"
                  "\"clearcoatTexture\":{\"index\":0,\"texCoord\":0},"
                  "\"clearcoatRoughnessTexture\":{\"index\":0,\"texCoord\":1},"
                  "\"clearcoatNormalTexture\":{\"index\":0,\"texCoord\":1,\"scale\":0.5}},"
                  "\"KHR_materials_anisotropy\":{\"anisotropyStrength\":1,"
                  "\"anisotropyTexture\":{\"index\":0,\"texCoord\":1}}}},{" DULL
                  "}") ",\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"TEXCOORD_1\":2},\"indices\":3,"
                       "\"material\":0},{\"attributes\":{\"POSITION\":0,\"TEXCOORD_1\":2},\"indices\":3,"
                       "\"material\":1}]}]," ONE_NODE "}");
    const struct kiln_gloss *g = DATA(struct kiln_gloss, KILN_SECTION_GLOSS);
    const struct kiln_texture *t = DATA(struct kiln_texture, KILN_SECTION_TEXTURES);
    assert_int_equal(COUNT(KILN_SECTION_GLOSS), 1);
    assert_int_equal(COUNT(KILN_SECTION_TEXTURES), 2);
    assert_int_equal(COUNT(KILN_SECTION_TEXELS), 4);
    const uint32_t linear = g->textures[KILN_GLOSS_METALLIC].texture;
    static const struct {
        enum kiln_gloss_use use;
        uint32_t channel;
    } uses[] = {{KILN_GLOSS_METALLIC, 2},         {KILN_GLOSS_ROUGHNESS, 1},
                {KILN_GLOSS_SPECULAR, 3},         {KILN_GLOSS_CLEARCOAT_ROUGHNESS, 1},
                {KILN_GLOSS_CLEARCOAT_NORMAL, 0}, {KILN_GLOSS_ANISOTROPY, 0}};
    for (size_t i = 0; i < sizeof uses / sizeof uses[0]; i++) {
        assert_int_equal(g->textures[uses[i].use].texture, linear);
        assert_int_equal(g->textures[uses[i].use].channel, uses[i].channel);
    }
    assert_int_equal(t[linear].srgb, 0);
    assert_int_equal(t[g->textures[KILN_GLOSS_SPECULAR_COLOR].texture].srgb, 1);
    assert_int_equal(g->textures[KILN_GLOSS_CLEARCOAT].texture, KILN_NONE);
    near((double)g->clearcoat, 128.0 / 255.0); /* of red: its coordinates are of another set */
    near((double)g->clearcoat_normal_scale, 0.5);
    near((double)g->mean_metallic, 1.0);
    near((double)g->mean_roughness, 128.0 / 255.0);
    static const float moved[6] = {2.0f, 0.0f, 0.25f, 0.0f, 3.0f, 0.5f}, as_it_is[6] = {1.0f, 0.0f, 0.0f, 0.0f, 1.0f};
    for (int c = 0; c < 6; c++) {
        near((double)g->textures[KILN_GLOSS_ROUGHNESS].transform[c], (double)moved[c]);
        near((double)g->textures[KILN_GLOSS_SPECULAR].transform[c], (double)as_it_is[c]);
    }
    /* the coordinates are those of the file; a vertex whose material has no gloss repeats the base colour's */
    const struct kiln_vec2 *uv = DATA(struct kiln_vec2, KILN_SECTION_TEXCOORD_GLOSS);
    assert_int_equal(COUNT(KILN_SECTION_TEXCOORD_GLOSS), 8);
    assert_memory_equal(uv, binary.uv, sizeof binary.uv);
    assert_memory_equal(uv + 4, DATA(struct kiln_vec2, KILN_SECTION_TEXCOORD_BASE) + 4, 4 * sizeof *uv);
}

/* Anisotropy needs a direction along u, also without a texture. */
static void anisotropy_has_coordinates(void **state)
{
    struct fixture *f = *state;
    accepted(f, MATERIALS(EXTENSION("anisotropy",
                                    "{\"anisotropyStrength\":0.5}")) ",\"meshes\":[{\"primitives\":[{\"attributes\":{"
                                                                     "\"POSITION\":0,\"TEXCOORD_0\":2},\"indices\":3,"
                                                                     "\"material\":0}]}]," ONE_NODE "}");
    assert_int_equal(COUNT(KILN_SECTION_TEXTURES), 0);
    assert_memory_equal(DATA(struct kiln_vec2, KILN_SECTION_TEXCOORD_GLOSS), binary.uv, sizeof binary.uv);
}

static void gloss_out_of_range_is_refused(void **state)
{
    struct fixture *f = *state;
    static const struct {
        const char *text, *word;
    } cases[] = {
        {MATERIALS(EXTENSION("ior", "{\"ior\":0.9}")) "}", "KHR_materials_ior.ior is 0.9, neither 0 nor at least 1"},
        {MATERIALS(EXTENSION("ior", "{\"ior\":-1}")) "}", "materials[0].ior"},
        {MATERIALS(EXTENSION("ior", "{\"ior\":\"glass\"}")) "}", "ior is a string"},
        {MATERIALS(EXTENSION("specular", "{\"specularFactor\":1.1}")) "}", "specularFactor"},
        {MATERIALS(EXTENSION("specular", "{\"specularColorFactor\":[1,-1,1]}")) "}", "specularColorFactor"},
        {MATERIALS(EXTENSION("specular", "{\"specularColorFactor\":[1,1]}")) "}", "specularColorFactor"},
        {MATERIALS(EXTENSION("specular", "{\"specularTexture\":{\"index\":1}}")) "}", "index is 1"},
        {MATERIALS(EXTENSION("volume", "{\"thicknessFactor\":-1}")) "}", "thicknessFactor"},
        {MATERIALS(EXTENSION("volume", "{\"attenuationDistance\":0}")) "}", "attenuationDistance is 0, not above 0"},
        {MATERIALS(EXTENSION("volume", "{\"attenuationColor\":[1,1,1.5]}")) "}", "attenuationColor"},
        {MATERIALS(EXTENSION("dispersion", "{\"dispersion\":-0.5}")) "}", "dispersion"},
        {MATERIALS(EXTENSION("clearcoat", "{\"clearcoatFactor\":2}")) "}", "clearcoatFactor"},
        {MATERIALS(EXTENSION("clearcoat", "{\"clearcoatRoughnessFactor\":2}")) "}", "clearcoatRoughnessFactor"},
        {MATERIALS(EXTENSION("anisotropy", "{\"anisotropyStrength\":-0.1}")) "}", "anisotropyStrength"},
        {MATERIALS(EXTENSION("anisotropy", "{\"anisotropyRotation\":[1]}")) "}", "anisotropyRotation is an array"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        refused(f, cases[i].text, cases[i].word);
}

static void specular_glossiness_is_read(void **state)
{
    struct fixture *f = *state;
    accepted(f, MATERIALS("{\"pbrMetallicRoughness\":{\"baseColorFactor\":[1,1,1,1]},\"extensions\":{"
                          "\"KHR_materials_pbrSpecularGlossiness\":{\"diffuseFactor\":[0.5,0.25,0.125,1],"
                          "\"specularFactor\":[0.5,0.25,1],\"glossinessFactor\":0.75}}},"
                          "{\"extensions\":{\"KHR_materials_pbrSpecularGlossiness\":{\"diffuseFactor\":[0.5,0.1,0.1,1],"
                          "\"specularFactor\":[0,0,0],\"glossinessFactor\":0}}},"
                          "{\"extensions\":{\"KHR_materials_pbrSpecularGlossiness\":{\"diffuseFactor\":[0,0,0,1],"
                          "\"specularFactor\":[0.75,0.5,0.25],\"glossinessFactor\":0.5}}}") "}");
    const struct kiln_material *m = DATA(struct kiln_material, KILN_SECTION_MATERIALS);
    const struct kiln_gloss *gloss = DATA(struct kiln_gloss, KILN_SECTION_GLOSS);
    assert_int_equal(COUNT(KILN_SECTION_NOTES), 0);
    near((double)m[0].base_color[0], 0.5);
    near((double)m[0].base_color[2], 0.125);
    near((double)m[0].metallic, 0.0);
    near((double)gloss[0].ior, 0.0); /* reflects its specular colour at any angle */
    near((double)gloss[0].specular_color[0], 0.5);
    near((double)gloss[0].specular_color[2], 1.0);
    near((double)gloss[0].roughness, 0.25);
    near((double)m[1].base_color[1], 0.1);
    near((double)m[1].roughness, 1.0);
    assert_int_equal(kiln_gloss_kind(&m[1], &gloss[1]), KILN_GLOSS_KIND_DIFFUSE);
    near((double)m[2].metallic, 1.0); /* black below a bright specular colour: a metal of that colour */
    near((double)m[2].base_color[2], 0.25);
    near((double)m[2].roughness, 0.5);
    refused(f, MATERIALS("{\"extensions\":{\"KHR_materials_pbrSpecularGlossiness\":{\"glossinessFactor\":2}}}") "}",
            "glossinessFactor");
}

/* Two pixels of opaque colours: alpha 1, so that roughness is 1 - the factor. */
static void glossiness_has_a_texture(void **state)
{
    struct fixture *f = *state;
    accepted(f, HEAD ACCESSORS("") "," TWO_PIXELS ",\"textures\":[{\"source\":0}],\"materials\":[{\"extensions\":{"
                                   "\"KHR_materials_pbrSpecularGlossiness\":{\"diffuseTexture\":{\"index\":0},"
                                   "\"specularGlossinessTexture\":{\"index\":0},\"glossinessFactor\":0.6}}}]}");
    const struct kiln_gloss *gloss = DATA(struct kiln_gloss, KILN_SECTION_GLOSS);
    const struct kiln_texture *textures = DATA(struct kiln_texture, KILN_SECTION_TEXTURES);
    const struct kiln_gloss_texture *roughness = &gloss[0].textures[KILN_GLOSS_ROUGHNESS];
    assert_int_not_equal(DATA(struct kiln_material, KILN_SECTION_MATERIALS)[0].base_color_texture, KILN_NONE);
    assert_int_not_equal(gloss[0].textures[KILN_GLOSS_SPECULAR_COLOR].texture, KILN_NONE);
    assert_int_not_equal(roughness->texture, KILN_NONE);
    near((double)gloss[0].roughness, 1.0);
    near((double)gloss[0].mean_roughness, (double)0.4f);
    assert_int_equal(DATA(uint8_t, KILN_SECTION_TEXELS)[textures[roughness->texture].first + roughness->channel], 102);
}

/* KHR_materials_unlit: neither emission nor metal nor gloss counts. */
static void unlit_is_diffuse_and_dark(void **state)
{
    struct fixture *f = *state;
    accepted(f, MATERIALS("{\"emissiveFactor\":[1,1,1],\"pbrMetallicRoughness\":{\"roughnessFactor\":0.1,"
                          "\"baseColorFactor\":[0.2,0.6,0.2,1]},\"extensions\":{\"KHR_materials_unlit\":{},"
                          "\"KHR_materials_clearcoat\":{\"clearcoatFactor\":1}}}") "}");
    const struct kiln_material *m = DATA(struct kiln_material, KILN_SECTION_MATERIALS);
    near((double)m[0].emission[0], 0.0);
    near((double)m[0].metallic, 0.0);
    near((double)m[0].base_color[1], 0.6);
    assert_int_equal(COUNT(KILN_SECTION_GLOSS), 0);
}

static void colors_are_normalised(void **state)
{
    struct fixture *f = *state;
    accepted(f, HEAD ACCESSORS(",{\"bufferView\":6,\"componentType\":5121,\"normalized\":true,\"count\":4,\"type\":"
                               "\"VEC4\"}") ","
                                            "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0,\"COLOR_0\":"
                                            "4},\"indices\":3}]}]," ONE_NODE "}");
    assert_memory_equal(DATA(uint8_t, KILN_SECTION_COLORS), binary.colors, sizeof binary.colors);
}

static void instances_are_objects(void **state)
{
    struct fixture *f = *state;
    accepted(
        f, HEAD ACCESSORS(
               ",{\"bufferView\":7,\"componentType\":5126,\"count\":2,\"type\":\"VEC3\"}") "," QUAD
                                                                                           ",\"scenes\":[{\"nodes\":[0]"
                                                                                           "}],\"nodes\":[{\"mesh\":0,"
                                                                                           "\"name\":\"tree\","
                                                                                           "\"translation\":[1,1,1],"
                                                                                           "\"extensions\":{\"EXT_mesh_"
                                                                                           "gpu_instancing\":{"
                                                                                           "\"attributes\":{"
                                                                                           "\"TRANSLATION\":4}}}}]}");
    const struct kiln_object *o = DATA(struct kiln_object, KILN_SECTION_OBJECTS);
    assert_int_equal(COUNT(KILN_SECTION_OBJECTS), 2);
    near(o[0].transform[3], 11);
    near(o[1].transform[7], 21);
    assert_string_equal(DATA(char, KILN_SECTION_STRINGS) + o[1].name, "tree_1");
}

static void lights_and_cameras(void **state)
{
    struct fixture *f = *state;
    accepted(f, HEAD ACCESSORS(
                    "") ",\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"spot\",\"color\":[1,0.5,0],"
                        "\"intensity\":10,\"range\":3,"
                        "\"spot\":{\"innerConeAngle\":0.2,\"outerConeAngle\":0.5}},{\"type\":\"directional\"}]}},"
                        "\"cameras\":[{\"type\":\"perspective\",\"name\":\"eye\",\"perspective\":{\"yfov\":0.8,"
                        "\"znear\":0.1,\"aspectRatio\":2}}],"
                        "\"scenes\":[{\"nodes\":[0,1],\"extras\":{\"environment\":{\"type\":\"constant\",\"radiance\":["
                        "1,2,3]}}}],\"nodes\":["
                        "{\"rotation\":[-0.70710678118654752,0,0,0.70710678118654752],\"translation\":[4,5,6],"
                        "\"extensions\":{\"KHR_lights_punctual\":{\"light\":0}}},"
                        "{\"camera\":0,\"scale\":[3,3,3],\"extensions\":{\"KHR_lights_punctual\":{\"light\":1}}}]}");
    const struct kiln_light *l = DATA(struct kiln_light, KILN_SECTION_LIGHTS);
    assert_int_equal(COUNT(KILN_SECTION_LIGHTS), 2);
    assert_int_equal(l[0].kind, KILN_LIGHT_SPOT);
    near(l[0].position[1], 5);
    near((double)l[0].direction[1], -1); /* -z turned by -90 degrees about x looks down */
    near((double)l[0].intensity[1], 5);
    near((double)l[0].range, 3);
    near((double)l[0].cos_inner, cos(0.2));
    near((double)l[0].cos_outer, cos(0.5));
    assert_int_equal(l[1].kind, KILN_LIGHT_DIRECTIONAL);
    near((double)l[1].direction[2], -1);
    const struct kiln_camera *c = DATA(struct kiln_camera, KILN_SECTION_CAMERAS);
    assert_string_equal(DATA(char, KILN_SECTION_STRINGS) + c->name, "eye");
    near((double)c->forward[2], -1);
    near((double)c->right[0], 1); /* unit, whatever the node's scale */
    near((double)c->aspect, 2);
    const struct kiln_environment *e = DATA(struct kiln_environment, KILN_SECTION_ENVIRONMENT);
    assert_int_equal(e->kind, KILN_ENVIRONMENT_CONSTANT);
    near((double)e->radiance[2], 3);
}

static void faults_have_a_place(void **state)
{
    struct fixture *f = *state;
    static const struct {
        const char *text, *word;
    } cases[] = {
        {"", "empty"},
        {"[]", "not an object"},
        {"{\"asset\":{\"version\":\"2.0\",\"version\":\"2.0\"}}", "duplicate"},
        {"{\"asset\":{\"version\":\"2.0\"},\"nodes\":[1]}", "nodes[0]"},
        {"{\"asset\":{\"version\":\"2.0\"},\"nodes\":{}}", "nodes is an object"},
        {"{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"children\":[1]},{\"children\":[0]}]}", "cycle"},
        {"{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"rotation\":[0,0,0,0]}]}", "nodes[0].rotation"},
        {"{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"matrix\":[1,0,0,0,0,0,0,0,0,0,1,0,0,0,0,1]}]}", "singular"},
        {"{\"asset\":{\"version\":\"2.0\"},\"scene\":0}", "scene is 0"},
        {"{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":4}]}", "buffers[0].uri"},
        {"{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":4,\"uri\":\"%2e%2e/x\"}]}", "leads out"},
        {"{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":4,\"uri\":\"a%00b\"}]}", "percent"},
        {"{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":4,\"uri\":\"data:,abcd\"}]}", "base64"},
        {"{\"asset\":{\"version\":\"2.0\"},\"images\":[{\"uri\":\"https://example.org/x.png\"}]}", "images[0].uri"},
        {"{\"asset\":{\"version\":\"2.0\"},\"extensionsRequired\":[\"EXT_texture_webp\"]}", "WebP"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        refused(f, cases[i].text, cases[i].word);
    refused(f, HEAD ACCESSORS(",{\"bufferView\":0,\"componentType\":5126,\"count\":5,\"type\":\"VEC3\"}") "}",
            "accessors[4].count");
    refused(f, HEAD ACCESSORS(",{\"bufferView\":0,\"componentType\":5126,\"count\":4.5,\"type\":\"VEC3\"}") "}",
            "accessors[4].count");
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
    const struct CMUnitTest tests[] = {TEST(a_quad_comes_through),
                                       TEST(nodes_multiply_and_names_are_unique),
                                       TEST(strips_and_fans_keep_their_winding),
                                       TEST(winding_decides_and_normals_follow),
                                       TEST(triangles_without_area_are_left_out),
                                       TEST(sparse_values_replace),
                                       TEST(materials),
                                       TEST(glass),
                                       TEST(glass_has_a_texture),
                                       TEST(texture_transforms_follow_the_specification),
                                       TEST(normal_maps_are_read),
                                       TEST(only_what_says_more_has_gloss),
                                       TEST(gloss_has_its_numbers),
                                       TEST(gloss_has_textures),
                                       TEST(anisotropy_has_coordinates),
                                       TEST(gloss_out_of_range_is_refused),
                                       TEST(specular_glossiness_is_read),
                                       TEST(glossiness_has_a_texture),
                                       TEST(unlit_is_diffuse_and_dark),
                                       TEST(colors_are_normalised),
                                       TEST(instances_are_objects),
                                       TEST(lights_and_cameras),
                                       TEST(faults_have_a_place)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
