/* Tests of the scene file: it is read as it was written; a file with any damaged bit or of any other length is refused
 * with a message. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <fcntl.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/scene/builder.h"
#include "worker/scene/gloss.h"

struct fixture {
    char folder[64], path[96], damaged[96];
    unsigned char *bytes;
    size_t size;
    bool normal_map, gloss;
};

static uint32_t text(struct kiln_builder *b, const char *string)
{
    uint32_t offset = 0;
    assert_int_equal(kiln_builder_string(b, string, strlen(string), &offset, NULL), KILN_OK);
    return offset;
}

static void append(struct kiln_builder *b, enum kiln_scene_section section, const void *data, size_t count)
{
    assert_int_equal(kiln_builder_append(b, section, data, count, NULL, NULL), KILN_OK);
}

/* Two objects of one quad, a texture, a light, a camera, an environment image, a source, a note, and perhaps a normal
 * map and gloss: something in every section. */
static void build(const char *path, bool normal_map, bool gloss)
{
    struct kiln_builder *b = NULL;
    assert_int_equal(kiln_builder_create(&b, NULL), KILN_OK);
    const struct kiln_vec3 positions[4] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
    const struct kiln_vec3 normals[4] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
    const struct kiln_vec2 uv[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    const uint8_t colors[16] = {255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255};
    const uint32_t triangles[6] = {0, 1, 2, 0, 2, 3}, materials[2] = {0, 0};
    const uint8_t texels[16] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16};
    const float sky[6] = {1, 2, 3, 4, 5, 6};
    const struct kiln_material material = {.name = text(b, "paint"),
                                           .base_color = {0.5f, 0.5f, 0.5f, 1},
                                           .base_color_texture = 0,
                                           .emission_texture = KILN_NONE};
    const struct kiln_texture texture = {.width = 2, .height = 2};
    const struct kiln_mesh mesh = {
        .name = text(b, "quad"), .vertex_count = 4, .triangle_count = 2, .surface_area = 1, .uv_area = 1};
    struct kiln_object object = {.name = text(b, "first"),
                                 .transform = {1, 0, 0, 10, 0, 1, 0, 20, 0, 0, 1, 30},
                                 .lightmap_width = 8,
                                 .lightmap_height = 8};
    object.original_name = text(b, "First of all");
    append(b, KILN_SECTION_OBJECTS, &object, 1);
    object.name = text(b, "second");
    object.transform[3] = -10;
    append(b, KILN_SECTION_OBJECTS, &object, 1);
    const struct kiln_light light = {.name = object.name, .direction = {0, -1, 0}, .intensity = {1, 1, 1}};
    const struct kiln_camera camera = {
        .name = object.name, .forward = {0, 0, -1}, .up = {0, 1, 0}, .right = {1, 0, 0}, .extent_y = 1};
    const struct kiln_environment environment = {
        .kind = KILN_ENVIRONMENT_LATLONG, .radiance = {1, 1, 1}, .width = 2, .height = 1};
    const struct kiln_source source = {.path = text(b, "scene.glb"), .size = 12, .hash = {1, 2}};
    append(b, KILN_SECTION_POSITIONS, positions, 4);
    append(b, KILN_SECTION_NORMALS, normals, 4);
    append(b, KILN_SECTION_TEXCOORD_BASE, uv, 4);
    append(b, KILN_SECTION_TEXCOORD_EMISSION, uv, 4);
    append(b, KILN_SECTION_TEXCOORD_LIGHTMAP, uv, 4);
    append(b, KILN_SECTION_COLORS, colors, 4);
    append(b, KILN_SECTION_TRIANGLES, triangles, 2);
    append(b, KILN_SECTION_TRIANGLE_MATERIALS, materials, 2);
    append(b, KILN_SECTION_TEXELS, texels, 16);
    append(b, KILN_SECTION_TEXTURES, &texture, 1);
    append(b, KILN_SECTION_MATERIALS, &material, 1);
    append(b, KILN_SECTION_MESHES, &mesh, 1);
    append(b, KILN_SECTION_LIGHTS, &light, 1);
    append(b, KILN_SECTION_CAMERAS, &camera, 1);
    append(b, KILN_SECTION_ENVIRONMENT, &environment, 1);
    append(b, KILN_SECTION_ENVIRONMENT_TEXELS, sky, 6);
    append(b, KILN_SECTION_SOURCES, &source, 1);
    if (normal_map) {
        const struct kiln_normal_map map = {.material = 0, .texture = 0, .scale = 0.5f};
        append(b, KILN_SECTION_NORMAL_MAPS, &map, 1);
        append(b, KILN_SECTION_TEXCOORD_NORMAL, uv, 4);
    }
    if (gloss) {
        struct kiln_gloss glass = kiln_gloss_default(&material, 0);
        glass.transmission = 0.75f;
        glass.textures[KILN_GLOSS_TRANSMISSION].texture = 0;
        append(b, KILN_SECTION_GLOSS, &glass, 1);
        append(b, KILN_SECTION_TEXCOORD_GLOSS, uv, 4);
    }
    assert_int_equal(kiln_builder_note(b, 1, NULL, "%d things", 7), KILN_OK);
    assert_int_equal(kiln_builder_write(b, path, NULL), KILN_OK);
    kiln_builder_destroy(&b);
}

static int make(void **state, bool normal_map, bool gloss)
{
    struct fixture *f = calloc(1, sizeof *f);
    f->normal_map = normal_map;
    f->gloss = gloss;
    (void)snprintf(f->folder, sizeof f->folder, "/tmp/kiln-test-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    (void)snprintf(f->path, sizeof f->path, "%s/a.kscene", f->folder);
    (void)snprintf(f->damaged, sizeof f->damaged, "%s/b.kscene", f->folder);
    build(f->path, normal_map, gloss);
    FILE *file = fopen(f->path, "rb");
    assert_non_null(file);
    f->bytes = malloc(1 << 16);
    f->size = fread(f->bytes, 1, 1 << 16, file);
    (void)fclose(file);
    *state = f;
    return 0;
}

static int set_up(void **state) { return make(state, true, true); }
static int set_up_mapped(void **state) { return make(state, true, false); }
static int set_up_plain(void **state) { return make(state, false, false); }

static int tear_down(void **state)
{
    struct fixture *f = *state;
    (void)unlink(f->path);
    (void)unlink(f->damaged);
    (void)rmdir(f->folder);
    free(f->bytes);
    free(f);
    return 0;
}

static void put(const struct fixture *f, const unsigned char *bytes, size_t size)
{
    FILE *file = fopen(f->damaged, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    (void)fclose(file);
}

static int open_damaged(const struct fixture *f, struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    const int status = kiln_scene_open(&scene, f->damaged, error);
    assert_true((status == KILN_OK) == (scene != NULL));
    kiln_scene_close(&scene);
    return status;
}

static void what_is_written_comes_back(void **state)
{
    const struct fixture *f = *state;
    struct kiln_scene *s = NULL;
    assert_int_equal(kiln_scene_open(&s, f->path, NULL), KILN_OK);
    assert_int_equal(s->object_count, 2);
    assert_int_equal(s->triangle_count, 2);
    assert_string_equal(kiln_scene_string(s, s->objects[1].name), "second");
    assert_string_equal(kiln_scene_string(s, s->objects[1].original_name), "First of all");
    assert_string_equal(kiln_scene_string(s, s->notes[0].text), "7 things");
    assert_int_equal(s->triangles[5], 3);
    assert_true(s->environment_texels[5] == 6.0f);
    assert_int_equal(s->texels[15], 16);
    assert_int_equal(s->normal_map_count, 1);
    assert_true(s->normal_maps[0].scale == 0.5f);
    assert_memory_equal(s->texcoord_normal, s->texcoord_base, 4 * sizeof *s->texcoord_normal);
    assert_int_equal(s->gloss_count, 1);
    assert_true(kiln_gloss_find(s, 0) == s->glosses && kiln_gloss_find(s, 1) == NULL);
    assert_true(s->glosses[0].transmission == 0.75f && s->glosses[0].ior == 1.5f);
    assert_memory_equal(s->texcoord_gloss, s->texcoord_base, 4 * sizeof *s->texcoord_gloss);
    /* bounds of both objects: x from -10 to 11 */
    assert_true(s->header->bounds_min[0] == -10.0 && s->header->bounds_max[0] == 11.0);
    assert_true(s->header->centre[0] == 0.5 && s->header->centre[1] == 20.5 && s->header->centre[2] == 30.0);
    for (int i = 0; i < KILN_SECTION_COUNT; i++)
        assert_int_equal(s->header->sections[i].offset % 64, 0);
    kiln_scene_close(&s);
    assert_null(s);
}

static void writing_again_gives_the_same_bytes(void **state)
{
    const struct fixture *f = *state;
    build(f->damaged, f->normal_map, f->gloss);
    unsigned char *again = malloc(f->size + 1);
    FILE *file = fopen(f->damaged, "rb");
    assert_non_null(file);
    assert_int_equal(fread(again, 1, f->size + 1, file), f->size);
    (void)fclose(file);
    assert_memory_equal(again, f->bytes, f->size);
    free(again);
}

static void any_flipped_bit_is_refused(void **state)
{
    const struct fixture *f = *state;
    const size_t end = f->gloss ? f->size : 512; /* what differs without it is the header */
    for (size_t byte = 0; byte < end; byte++) {
        struct kiln_error error = {""};
        const unsigned char bit = (unsigned char)(1u << (byte % 8));
        f->bytes[byte] ^= bit;
        put(f, f->bytes, f->size);
        f->bytes[byte] ^= bit;
        if (open_damaged(f, &error) != KILN_BAD_INPUT)
            fail_msg("bit %zu of byte %zu flipped: accepted", byte % 8, byte);
        assert_non_null(strstr(error.message, f->damaged));
    }
}

static void any_truncation_is_refused(void **state)
{
    const struct fixture *f = *state;
    for (size_t size = f->gloss ? 0 : 460; size < f->size; size += size < 600 ? 1 : 37) {
        struct kiln_error error = {""};
        put(f, f->bytes, size);
        if (open_damaged(f, &error) != KILN_BAD_INPUT)
            fail_msg("cut to %zu bytes: accepted", size);
    }
    f->bytes[f->size] = 0;
    put(f, f->bytes, f->size + 1);
    assert_int_equal(open_damaged(f, NULL), KILN_BAD_INPUT);
}

/* Changes bytes of a section's element, makes the hash right again, and wants a refusal that says `word`. */
static void forged(const struct fixture *f, enum kiln_scene_section section, size_t offset, const void *bytes,
                   size_t size, const char *word)
{
    unsigned char *copy = malloc(f->size);
    struct kiln_scene_header header;
    struct kiln_error error = {""};
    memcpy(copy, f->bytes, f->size);
    memcpy(&header, copy, sizeof header);
    memcpy(copy + header.sections[section].offset + offset, bytes, size);
    const size_t header_bytes = kiln_scene_header_bytes(header.version);
    kiln_scene_content_hash(&header, copy + header_bytes, header.content_hash);
    memcpy(copy, &header, header_bytes);
    put(f, copy, f->size);
    free(copy);
    assert_int_equal(open_damaged(f, &error), KILN_BAD_INPUT);
    if (strstr(error.message, word) == NULL)
        fail_msg("'%s' does not say '%s'", error.message, word);
}

static void a_right_hash_is_no_excuse(void **state)
{
    const struct fixture *f = *state;
    const uint32_t big = 1000000, four = 4, three = 3, zero = 0;
    const float nan_value = NAN, outside = 1.5f, negative = -1.0f;
    const double infinite = INFINITY;
    const uint64_t far = 1u << 30;
    forged(f, KILN_SECTION_TRIANGLES, 8, &four, 4, "corner 4, but there are 4");
    forged(f, KILN_SECTION_TRIANGLE_MATERIALS, 4, &big, 4, "material 1000000");
    forged(f, KILN_SECTION_POSITIONS, 4, &nan_value, 4, "position");
    forged(f, KILN_SECTION_NORMALS, 8, &outside, 4, "unit vector");
    forged(f, KILN_SECTION_TEXCOORD_BASE, 0, &nan_value, 4, "texture coordinate");
    forged(f, KILN_SECTION_TEXCOORD_LIGHTMAP, 4, &outside, 4, "lightmap coordinate");
    forged(f, KILN_SECTION_MATERIALS, offsetof(struct kiln_material, base_color), &outside, 4, "material 0");
    forged(f, KILN_SECTION_MATERIALS, offsetof(struct kiln_material, emission), &negative, 4, "material 0");
    forged(f, KILN_SECTION_MATERIALS, offsetof(struct kiln_material, base_color_texture), &three, 4, "material 0");
    forged(f, KILN_SECTION_TEXTURES, offsetof(struct kiln_texture, first), &far, 8, "texture 0");
    forged(f, KILN_SECTION_TEXTURES, offsetof(struct kiln_texture, width), &big, 4, "texture 0");
    forged(f, KILN_SECTION_TEXTURES, offsetof(struct kiln_texture, wrap_u), &three, 4, "unknown mode");
    forged(f, KILN_SECTION_MESHES, offsetof(struct kiln_mesh, vertex_first), &far, 8, "mesh 0");
    forged(f, KILN_SECTION_MESHES, offsetof(struct kiln_mesh, triangle_count), &far, 8, "mesh 0");
    forged(f, KILN_SECTION_OBJECTS, offsetof(struct kiln_object, mesh), &three, 4, "object 0");
    forged(f, KILN_SECTION_OBJECTS, offsetof(struct kiln_object, transform), &infinite, 8, "object 0");
    forged(f, KILN_SECTION_OBJECTS, offsetof(struct kiln_object, lightmap_width), &zero, 4, "lightmap of 0");
    forged(f, KILN_SECTION_OBJECTS, offsetof(struct kiln_object, name), &big, 4, "object 0");
    forged(f, KILN_SECTION_LIGHTS, offsetof(struct kiln_light, intensity), &negative, 4, "light 0");
    forged(f, KILN_SECTION_CAMERAS, offsetof(struct kiln_camera, extent_y), &zero, 4, "camera 0");
    forged(f, KILN_SECTION_ENVIRONMENT, offsetof(struct kiln_environment, width), &big, 4, "environment");
    forged(f, KILN_SECTION_ENVIRONMENT_TEXELS, 8, &negative, 4, "environment");
    forged(f, KILN_SECTION_SOURCES, 0, &big, 4, "source 0");
    forged(f, KILN_SECTION_NOTES, 4, &big, 4, "note 0");
    forged(f, KILN_SECTION_NORMAL_MAPS, offsetof(struct kiln_normal_map, material), &three, 4, "normal map 0");
    forged(f, KILN_SECTION_NORMAL_MAPS, offsetof(struct kiln_normal_map, texture), &three, 4, "normal map 0");
    forged(f, KILN_SECTION_NORMAL_MAPS, offsetof(struct kiln_normal_map, scale), &nan_value, 4, "scale");
    forged(f, KILN_SECTION_TEXCOORD_NORMAL, 28, &nan_value, 4, "normal-map coordinate");
    forged(f, KILN_SECTION_TEXCOORD_GLOSS, 28, &nan_value, 4, "gloss coordinate");
}

static void gloss_with_a_right_hash_is_no_excuse(void **state)
{
    const struct fixture *f = *state;
    const uint32_t three = 3, nine = 9;
    const float nan_value = NAN, above = 1.5f, half = 0.5f, negative = -1.0f, endless = INFINITY;
    const size_t texture =
        offsetof(struct kiln_gloss, textures) + KILN_GLOSS_ANISOTROPY * sizeof(struct kiln_gloss_texture);
    const struct {
        size_t offset;
        const void *bytes;
        const char *word;
    } cases[] = {
        {offsetof(struct kiln_gloss, material), &three, "gloss 0 refers to a material"},
        {offsetof(struct kiln_gloss, model), &three, "unknown model"},
        {offsetof(struct kiln_gloss, flags), &nine, "unknown model or flag"},
        {offsetof(struct kiln_gloss, metallic), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, mean_metallic), &negative, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, roughness), &negative, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, mean_roughness), &nan_value, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, ior), &half, "index of refraction"},
        {offsetof(struct kiln_gloss, ior), &nan_value, "index of refraction"},
        {offsetof(struct kiln_gloss, specular), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, specular_color) + 4, &negative, "below 0"},
        {offsetof(struct kiln_gloss, specular_color) + 8, &endless, "without an end"},
        {offsetof(struct kiln_gloss, transmission), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, filter), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, thickness), &negative, "below 0"},
        {offsetof(struct kiln_gloss, attenuation_color), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, attenuation_distance), &endless, "without an end"},
        {offsetof(struct kiln_gloss, dispersion), &nan_value, "below 0"},
        {offsetof(struct kiln_gloss, clearcoat), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, clearcoat_roughness), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, clearcoat_normal_scale), &endless, "scale or an angle"},
        {offsetof(struct kiln_gloss, anisotropy), &above, "outside 0 to 1"},
        {offsetof(struct kiln_gloss, anisotropy_rotation), &nan_value, "scale or an angle"},
        {offsetof(struct kiln_gloss, exponent), &negative, "below 0"},
        {texture, &three, "texture that does not exist"},
        {texture + 4, &nine, "channel"},
        {texture + 8 + 20, &nan_value, "texture transform"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        forged(f, KILN_SECTION_GLOSS, cases[i].offset, cases[i].bytes, 4, cases[i].word);
}

static uint32_t version_of(const struct fixture *f)
{
    uint32_t version;
    memcpy(&version, f->bytes + offsetof(struct kiln_scene_header, version), sizeof version);
    return version;
}

/* Without gloss the file is one of version 4, whose header has no entries for it. */
static void a_scene_without_gloss_is_of_the_version_before(void **state)
{
    const struct fixture *f = *state;
    struct kiln_scene *s = NULL;
    assert_int_equal(version_of(f), KILN_SCENE_VERSION_NORMAL_MAPS);
    assert_int_equal(kiln_scene_header_bytes(version_of(f)), 136 + 16 * 23);
    assert_int_equal(kiln_scene_open(&s, f->path, NULL), KILN_OK);
    assert_int_equal(s->normal_map_count, 1);
    assert_int_equal(s->gloss_count, 0);
    assert_null(kiln_gloss_find(s, 0));
    assert_null(s->texcoord_gloss);
    kiln_scene_close(&s);
}

/* Without normal maps the file is one of version 3, whose header has no entries for them. */
static void a_scene_without_normal_maps_is_of_the_version_before(void **state)
{
    const struct fixture *f = *state;
    struct kiln_scene *s = NULL;
    const uint32_t version = version_of(f);
    assert_int_equal(version, KILN_SCENE_VERSION_PLAIN);
    assert_int_equal(kiln_scene_header_bytes(version), 136 + 16 * 21);
    assert_int_equal(kiln_scene_open(&s, f->path, NULL), KILN_OK);
    assert_int_equal(s->header->sections[KILN_SECTION_STRINGS].offset, 512);
    assert_int_equal(s->normal_map_count, 0);
    assert_int_equal(s->header->sections[KILN_SECTION_TEXCOORD_NORMAL].count, 0);
    assert_null(s->texcoord_normal);
    kiln_scene_close(&s);
}

static void names_that_are_no_file_names_are_refused(void **state)
{
    const struct fixture *f = *state;
    struct kiln_scene_header header;
    memcpy(&header, f->bytes, sizeof header);
    const unsigned char *strings = f->bytes + header.sections[KILN_SECTION_STRINGS].offset;
    size_t at = 0;
    while (strcmp((const char *)strings + at, "first") != 0)
        at++;
    forged(f, KILN_SECTION_STRINGS, at, "../et", 5, "file name");
    forged(f, KILN_SECTION_STRINGS, at, ".hide", 5, "file name");
    forged(f, KILN_SECTION_STRINGS, header.sections[KILN_SECTION_STRINGS].count - 1, "x", 1, "NUL");
    /* two objects of one name would write one lightmap */
    uint32_t second;
    memcpy(&second, f->bytes + header.sections[KILN_SECTION_OBJECTS].offset + sizeof(struct kiln_object), 4);
    forged(f, KILN_SECTION_OBJECTS, 0, &second, 4, "'second'");
}

static void what_is_not_there_or_no_file_is_said(void **state)
{
    const struct fixture *f = *state;
    struct kiln_scene *scene = NULL;
    struct kiln_error error = {""};
    assert_int_equal(kiln_scene_open(&scene, "/tmp/kiln-is-not-there.kscene", &error), KILN_NO_INPUT);
    assert_non_null(strstr(error.message, "kiln-is-not-there"));
    assert_int_equal(kiln_scene_open(&scene, f->folder, &error), KILN_BAD_INPUT);
    assert_int_equal(kiln_scene_open(&scene, "/dev/zero", &error), KILN_BAD_INPUT);
    assert_null(scene);
}

static void objects_out_of_range_are_not_written(void **state)
{
    const struct fixture *f = *state;
    struct kiln_builder *b = NULL;
    struct kiln_error error = {""};
    const struct kiln_vec3 position = {1e11f, 0, 0};
    const struct kiln_mesh mesh = {.vertex_count = 1};
    struct kiln_object object = {.transform = {100, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    assert_int_equal(kiln_builder_create(&b, NULL), KILN_OK);
    object.original_name = text(b, "giant");
    append(b, KILN_SECTION_POSITIONS, &position, 1);
    append(b, KILN_SECTION_MESHES, &mesh, 1);
    append(b, KILN_SECTION_OBJECTS, &object, 1);
    assert_int_equal(kiln_builder_write(b, f->damaged, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "giant"));
    kiln_builder_destroy(&b);
}

/* Writes a part of one quad with settings of its object and a second UV set outside 0..1. */
static void build_part(const char *path, const struct kiln_object_settings *settings)
{
    struct kiln_builder *b = NULL;
    const struct kiln_vec3 positions[3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}},
                           normals[3] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
    const struct kiln_vec2 uv[3] = {{0, 0}, {7, 0}, {7, 7}};
    const uint8_t colors[12] = {0};
    const uint32_t corners[3] = {0, 1, 2}, material_of = 0;
    const struct kiln_environment none = {0};
    assert_int_equal(kiln_builder_create(&b, NULL), KILN_OK);
    const struct kiln_material material = {
        .name = text(b, "paint"), .base_color_texture = KILN_NONE, .emission_texture = KILN_NONE};
    const struct kiln_mesh mesh = {.name = text(b, "mesh"), .vertex_count = 3, .triangle_count = 1};
    const struct kiln_object object = {.name = text(b, "house.2/door"),
                                       .transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    append(b, KILN_SECTION_MATERIALS, &material, 1);
    append(b, KILN_SECTION_POSITIONS, positions, 3);
    append(b, KILN_SECTION_NORMALS, normals, 3);
    append(b, KILN_SECTION_TEXCOORD_BASE, uv, 3);
    append(b, KILN_SECTION_TEXCOORD_EMISSION, uv, 3);
    append(b, KILN_SECTION_TEXCOORD_LIGHTMAP, uv, 3);
    append(b, KILN_SECTION_COLORS, colors, 3);
    append(b, KILN_SECTION_TRIANGLES, corners, 1);
    append(b, KILN_SECTION_TRIANGLE_MATERIALS, &material_of, 1);
    append(b, KILN_SECTION_ENVIRONMENT, &none, 1);
    append(b, KILN_SECTION_MESHES, &mesh, 1);
    append(b, KILN_SECTION_OBJECTS, &object, 1);
    b->mesh_has_lightmap_uv[0] = KILN_LIGHTMAP_UV_GIVEN;
    b->object_settings[0] = *settings;
    assert_int_equal(kiln_builder_make_part(b, NULL), KILN_OK);
    assert_int_equal(kiln_builder_write(b, path, NULL), KILN_OK);
    kiln_builder_destroy(&b);
}

static int open_part(const char *path, struct kiln_scene **scene, struct kiln_error *error)
{
    return kiln_scene_open_part(scene, open(path, O_RDONLY | O_CLOEXEC), path, error);
}

static void a_part_keeps_settings_and_is_no_scene(void **state)
{
    const struct fixture *f = *state;
    const struct kiln_object_settings settings = {.density_scale = 2.5,
                                                  .lightmap_size = 64,
                                                  .role = KILN_ROLE_CASTER_ONLY,
                                                  .size_of_file = true,
                                                  .lod_member = 3};
    struct kiln_scene *s = NULL;
    struct kiln_error error = {""};
    build_part(f->damaged, &settings);
    assert_int_equal(kiln_scene_open(&s, f->damaged, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "the scene file of a part"));
    assert_int_equal(open_part(f->damaged, &s, &error), KILN_OK);
    assert_memory_equal(s->object_settings, &settings, sizeof settings);
    assert_int_equal(s->meshes[0].flags & KILN_MESH_HAS_SECOND_UV, KILN_MESH_HAS_SECOND_UV);
    assert_int_equal(s->meshes[0].flags & KILN_MESH_SOUND_SECOND_UV, 0);
    assert_true(s->texcoord_lightmap[1].x == 7.0f);
    assert_int_equal(kiln_scene_place(s, 0), strlen("house.2"));
    assert_int_equal(kiln_scene_place_end(s, 0), 1);
    kiln_scene_close(&s);
    assert_int_equal(open_part(f->path, &s, &error), KILN_BAD_INPUT);
    assert_null(s);
}

static void settings_out_of_range_are_refused(void **state)
{
    const struct fixture *f = *state;
    const struct kiln_object_settings wrong[] = {{.density_scale = -1.0},       {.density_scale = (double)NAN},
                                                 {.lightmap_size = 1u << 20},   {.role = KILN_ROLE_RECEIVER_ONLY + 1},
                                                 {.sides = KILN_SIDES_TWO + 1}, {.exclude = KILN_EXCLUDE_YES + 1},
                                                 {.lod_name = 1u << 30}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct kiln_scene *s = NULL;
        struct kiln_error error = {""};
        build_part(f->damaged, &wrong[i]);
        assert_int_equal(open_part(f->damaged, &s, &error), KILN_BAD_INPUT);
        assert_non_null(strstr(error.message, "settings of object 0"));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_is_written_comes_back, set_up, tear_down),
        cmocka_unit_test_setup_teardown(writing_again_gives_the_same_bytes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(any_flipped_bit_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(any_truncation_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_scene_without_normal_maps_is_of_the_version_before, set_up_plain, tear_down),
        cmocka_unit_test_setup_teardown(writing_again_gives_the_same_bytes, set_up_plain, tear_down),
        cmocka_unit_test_setup_teardown(any_flipped_bit_is_refused, set_up_plain, tear_down),
        cmocka_unit_test_setup_teardown(any_truncation_is_refused, set_up_plain, tear_down),
        cmocka_unit_test_setup_teardown(a_scene_without_gloss_is_of_the_version_before, set_up_mapped, tear_down),
        cmocka_unit_test_setup_teardown(any_flipped_bit_is_refused, set_up_mapped, tear_down),
        cmocka_unit_test_setup_teardown(a_right_hash_is_no_excuse, set_up, tear_down),
        cmocka_unit_test_setup_teardown(gloss_with_a_right_hash_is_no_excuse, set_up, tear_down),
        cmocka_unit_test_setup_teardown(names_that_are_no_file_names_are_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_is_not_there_or_no_file_is_said, set_up, tear_down),
        cmocka_unit_test_setup_teardown(objects_out_of_range_are_not_written, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_part_keeps_settings_and_is_no_scene, set_up, tear_down),
        cmocka_unit_test_setup_teardown(settings_out_of_range_are_refused, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
