/* Tests of the parts of the OBJ reader: numbers, words and lines, polygons; and where maps of gloss lie. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/import/obj_polygon.h"
#include "coordinator/import/obj_symbols.h"
#include "coordinator/import/obj_text.h"
#include "coordinator/import/read.h"

static bool parse(const char *text, double *value)
{
    return obj_parse_number((struct obj_word){text, strlen(text)}, value);
}

static void numbers_are_those_of_the_c_library(void **state)
{
    (void)state;
    static const char *const given[] = {"0",
                                        "-0",
                                        "1",
                                        "+1",
                                        "-1.5",
                                        ".5",
                                        "5.",
                                        "1e3",
                                        "1E+3",
                                        "1e-3",
                                        "0.1",
                                        "123456789012345678",
                                        "0.000000000000000000000000123",
                                        "3.4028234e38",
                                        "1e-45",
                                        "1e-400",
                                        "2.2250738585072011e-308",
                                        "0.30000000000000004",
                                        "00012.500",
                                        "179769313486231570000e18"};
    for (size_t i = 0; i < sizeof given / sizeof given[0]; i++) {
        double value = -7.0;
        const bool fits = fabs(strtod(given[i], NULL)) <= 3e38;
        assert_int_equal(parse(given[i], &value), fits);
        if (fits)
            assert_memory_equal(&value, &(double){strtod(given[i], NULL)}, sizeof value);
    }
}

static void any_decimal_is_rounded_as_the_c_library_rounds_it(void **state)
{
    (void)state;
    srand(11);
    for (int i = 0; i < 20000; i++) {
        char text[64];
        double value;
        (void)snprintf(text, sizeof text, "%s%.*f", rand() % 2 ? "-" : "", rand() % 18,
                       (double)rand() / (1 + rand() % 1000));
        assert_true(parse(text, &value));
        assert_true(value == strtod(text, NULL));
        (void)snprintf(text, sizeof text, "%.*e", rand() % 18, ldexp((double)rand(), rand() % 60 - 60));
        assert_true(parse(text, &value));
        assert_true(value == strtod(text, NULL));
    }
}

static void what_is_no_number(void **state)
{
    (void)state;
    static const char *const given[] = {"",     "-",   "+",   ".",   "-.", "e5",  "1e",    "1e+",   "1.2.3",
                                        "0x10", "nan", "inf", "1,5", "1f", "--1", "1e999", "-4e38", "1 "};
    double value;
    for (size_t i = 0; i < sizeof given / sizeof given[0]; i++)
        assert_false(parse(given[i], &value));
    char *digits = malloc(100001);
    memset(digits, '1', 100000);
    digits[100000] = '\0';
    assert_false(parse(digits, &value));
    free(digits);
}

static void lines_and_words(void **state)
{
    (void)state;
    static const char text[] = "\r\n# c\n  f 1 \\\r\n 2\\\n3 # end\nusemtl  two words \r\n\n\\\nlast\\";
    const struct kiln_file file = {(const unsigned char *)text, sizeof text - 1};
    struct obj_text t;
    struct obj_word word;
    assert_int_equal(obj_text_open(&t, &file, "a.obj", "", NULL), KILN_OK);
    assert_true(obj_next_line(&t, &word) && obj_is(word, "f") && t.line == 3);
    static const char *const corners[] = {"1", "2", "3"};
    for (size_t i = 0; i < 3; i++)
        assert_true(obj_next_word(&t, &word) && obj_is(word, corners[i]));
    assert_false(obj_next_word(&t, &word));
    assert_true(obj_next_line(&t, &word) && obj_is(word, "usemtl") && t.line == 6);
    assert_true(obj_is(obj_rest(&t), "two words"));
    assert_true(obj_next_line(&t, &word) && obj_is(word, "last\\") && t.line == 9);
    assert_false(obj_next_line(&t, &word));
    obj_text_close(&t);
}

static void sixteen_bit_text(void **state)
{
    (void)state;
    static const unsigned char little[] = {0xff, 0xfe, 'v', 0, ' ', 0, 0x3d, 0xd8, 0x00, 0xde, 0xe9, 0},
                               big[] = {0xfe, 0xff, 0, 'v', 0, ' ', 0xd8, 0x3d, 0xde, 0x00, 0, 0xe9};
    const struct kiln_file files[] = {{little, sizeof little}, {big, sizeof big}};
    for (int i = 0; i < 2; i++) {
        struct obj_text t;
        struct obj_word word;
        assert_int_equal(obj_text_open(&t, &files[i], "a.obj", "", NULL), KILN_OK);
        assert_true(obj_next_line(&t, &word) && obj_is(word, "v"));
        assert_true(obj_is(obj_rest(&t), "\xf0\x9f\x98\x80\xc3\xa9"));
        obj_text_close(&t);
    }
}

static struct kiln_dvec3 area_of(const struct obj_polygon *p, size_t triangle)
{
    const uint32_t *c = p->triangles + 3 * triangle;
    const struct kiln_dvec3 a = p->points[c[0]];
    return dvec3_scale(dvec3_cross(dvec3_sub(p->points[c[1]], a), dvec3_sub(p->points[c[2]], a)), 0.5);
}

/* A star of `count` corners with radii from 0.3 to 1, in a tilted plane, turned either way round. */
static void make_star(struct obj_polygon *p, size_t count, bool reverse)
{
    assert_int_equal(obj_polygon_room(p, count, NULL), KILN_OK);
    for (size_t i = 0; i < count; i++) {
        const double r = 0.3 + 0.7 * rand() / RAND_MAX, angle = 2.0 * KILN_PI * (double)i / (double)count;
        const float x = (float)(r * cos(angle)), y = (float)(r * sin(angle));
        p->points[reverse ? count - 1 - i : i] = dvec3_of(vec3(x, y, 0.5f * x - 0.25f * y));
    }
}

/* The triangles all turn the same way and their areas add up to the polygon's: they cover it without an overlap. */
static void triangles_cover_polygons(void **state)
{
    (void)state;
    struct obj_polygon p = {0};
    srand(5);
    for (int k = 0; k < 400; k++) {
        const size_t count = 4 + (size_t)rand() % 40;
        make_star(&p, count, k % 2 == 1);
        struct kiln_dvec3 whole = dvec3(0, 0, 0);
        for (size_t i = 0; i < count; i++)
            whole = dvec3_add(whole, dvec3_scale(dvec3_cross(p.points[i], p.points[(i + 1) % count]), 0.5));
        assert_true(obj_polygon_cut(&p, count));
        double sum = 0.0;
        for (size_t i = 0; i + 2 < count; i++) {
            assert_true(dvec3_dot(area_of(&p, i), whole) > -1e-9);
            sum += dvec3_length(area_of(&p, i));
        }
        assert_true(fabs(sum - dvec3_length(whole)) < 1e-5);
    }
    obj_polygon_destroy(&p);
}

static void a_concave_quadrilateral_is_cut_at_its_reflex_corner(void **state)
{
    (void)state;
    struct obj_polygon p = {0};
    assert_int_equal(obj_polygon_room(&p, 4, NULL), KILN_OK);
    const struct kiln_vec3 corners[4] = {vec3(0, 0, 0), vec3(2, -1, 0), vec3(0.5f, 0, 0), vec3(2, 1, 0)};
    for (size_t shift = 0; shift < 4; shift++) {
        for (size_t i = 0; i < 4; i++)
            p.points[i] = dvec3_of(corners[(i + shift) % 4]);
        assert_true(obj_polygon_cut(&p, 4));
        for (size_t t = 0; t < 2; t++)
            assert_true(area_of(&p, t).z > 0.0);
    }
    obj_polygon_destroy(&p);
}

static void large_and_hopeless_polygons_end(void **state)
{
    (void)state;
    struct obj_polygon p = {0};
    const size_t many = 200000;
    assert_int_equal(obj_polygon_room(&p, many, NULL), KILN_OK);
    for (size_t i = 0; i < many; i++)
        p.points[i] = dvec3_of(vec3((float)cos(2.0 * KILN_PI * (double)i / (double)many) * 1e6f,
                                    (float)sin(2.0 * KILN_PI * (double)i / (double)many) * 1e6f, 0));
    (void)obj_polygon_cut(&p, many); /* rounding may make it concave: refused, then */
    for (size_t i = 0; i < OBJ_CONCAVE_MAX; i++)
        p.points[i] = dvec3_of(vec3((float)(rand() % 1000), (float)(rand() % 1000), (float)(rand() % 3)));
    assert_true(obj_polygon_cut(&p, OBJ_CONCAVE_MAX)); /* crosses itself everywhere */
    for (size_t i = 0; i < 3 * (OBJ_CONCAVE_MAX - 2); i++)
        assert_true(p.triangles[i] < OBJ_CONCAVE_MAX);
    for (size_t i = 0; i < 100; i++)
        p.points[i] = dvec3_of(vec3((float)i, 0, 0));
    assert_true(obj_polygon_cut(&p, 100));
    make_star(&p, OBJ_CONCAVE_MAX + 1, false);
    assert_false(obj_polygon_cut(&p, OBJ_CONCAVE_MAX + 1));
    obj_polygon_destroy(&p);
}

static void names_keep_their_numbers(void **state)
{
    (void)state;
    struct obj_symbols s = {0};
    char name[32];
    for (uint32_t round = 0; round < 2; round++)
        for (uint32_t i = 0; i < 5000; i++) {
            const int length = snprintf(name, sizeof name, "name %u", i);
            uint32_t value = i + 100 * round;
            assert_int_equal(obj_symbol(&s, name, (size_t)length, &value, NULL), KILN_OK);
            assert_int_equal(value, i);
        }
    obj_symbols_destroy(&s);
}

static void put(const char *folder, const char *name, const void *bytes, size_t size)
{
    char path[128];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(bytes, 1, size, file), size);
    (void)fclose(file);
}

/* -s and -o of a map: the gloss coordinate, transformed, is where the same map as base colour is read. */
static void maps_of_gloss_lie_where_those_of_colour_do(void **state)
{
    (void)state;
    static const char scene[] = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.1 0.2\nvt 0.9 0.3\nvt 0.4 0.8\n"
                                "usemtl a\nf 1/1 2/2 3/3\n",
                      materials[] = "newmtl a\nmap_Kd -s 2 3 1 -o 0.5 0.25 0 t.tga\n"
                                    "map_Pr -s 2 3 1 -o 0.5 0.25 0 t.tga\nmap_Pm t.tga\n";
    static const unsigned char image[18 + 6] = {[2] = 2, [12] = 2, [14] = 1, [16] = 24, [18] = 1, 2, 3, 4, 5, 6};
    static const char *const names[] = {"scene.obj", "m.mtl", "t.tga"};
    char folder[] = "/tmp/kiln-test-XXXXXX", path[64];
    struct kiln_builder *b = NULL;
    struct kiln_error error = {""};
    assert_non_null(mkdtemp(folder));
    put(folder, names[0], scene, sizeof scene - 1);
    put(folder, names[1], materials, sizeof materials - 1);
    put(folder, names[2], image, sizeof image);
    (void)snprintf(path, sizeof path, "%s/scene.obj", folder);
    assert_int_equal(kiln_builder_create(&b, NULL), KILN_OK);
    const struct kiln_import_params params = {.path = path, .environment_scale = 1.0};
    if (kiln_import_read(&params, NULL, b, &error) != KILN_OK)
        fail_msg("%s", error.message);
    const struct kiln_gloss *g = KILN_BUILDER_DATA(b, const struct kiln_gloss, KILN_SECTION_GLOSS);
    const struct kiln_vec2 *gloss = KILN_BUILDER_DATA(b, const struct kiln_vec2, KILN_SECTION_TEXCOORD_GLOSS),
                           *base = KILN_BUILDER_DATA(b, const struct kiln_vec2, KILN_SECTION_TEXCOORD_BASE);
    assert_int_equal(b->sections[KILN_SECTION_GLOSS].count, 1);
    assert_int_equal(b->sections[KILN_SECTION_TEXCOORD_GLOSS].count, 3);
    const float *t = g->textures[KILN_GLOSS_ROUGHNESS].transform, *same = g->textures[KILN_GLOSS_METALLIC].transform;
    for (int v = 0; v < 3; v++) {
        assert_true(fabsf(t[0] * gloss[v].x + t[1] * gloss[v].y + t[2] - base[v].x) < 1e-6f);
        assert_true(fabsf(t[3] * gloss[v].x + t[4] * gloss[v].y + t[5] - base[v].y) < 1e-6f);
        assert_true(same[0] == 1.0f && same[4] == 1.0f && same[2] == 0.0f && same[5] == 0.0f);
    }
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        (void)snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        (void)unlink(path);
    }
    (void)rmdir(folder);
    kiln_builder_destroy(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(numbers_are_those_of_the_c_library),
        cmocka_unit_test(any_decimal_is_rounded_as_the_c_library_rounds_it),
        cmocka_unit_test(what_is_no_number),
        cmocka_unit_test(lines_and_words),
        cmocka_unit_test(sixteen_bit_text),
        cmocka_unit_test(triangles_cover_polygons),
        cmocka_unit_test(a_concave_quadrilateral_is_cut_at_its_reflex_corner),
        cmocka_unit_test(large_and_hopeless_polygons_end),
        cmocka_unit_test(names_keep_their_numbers),
        cmocka_unit_test(maps_of_gloss_lie_where_those_of_colour_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
