/* Hashes of files in pieces: what the header says they are, by any number of threads; and manifests that have them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <omp.h>
#include <xxhash.h>

#include "coordinator/files/foreign_json.h"
#include "coordinator/output/manifest.h"
#include "coordinator/output/piece_hash.h"
#include "worker/base/memory.h"

enum { BYTES = 1000003, PIECE = 1 << 16 };

static uint8_t content[BYTES];

/* A file of the content's first `size` bytes, which has no name any more. */
static int make_file(size_t size)
{
    char name[] = "/tmp/kiln-test-pieces-XXXXXX";
    const int descriptor = mkstemp(name);
    assert_true(descriptor >= 0);
    assert_int_equal(unlink(name), 0);
    assert_int_equal(write(descriptor, content, size), (ssize_t)size);
    return descriptor;
}

static int set_up(void **state)
{
    uint32_t random = 1;
    (void)state;
    for (size_t i = 0; i < BYTES; i++) {
        random = random * 747796405u + 2891336453u;
        content[i] = (uint8_t)(random >> 24);
    }
    return 0;
}

/* The definition, written out. */
static struct kiln_hash expected(size_t size)
{
    uint8_t all[BYTES / PIECE + 1][16];
    size_t count = 0;
    for (size_t at = 0; at < size; at += PIECE) {
        const XXH128_hash_t hash = XXH3_128bits(content + at, size - at < PIECE ? size - at : PIECE);
        for (int i = 0; i < 8; i++) {
            all[count][i] = (uint8_t)(hash.high64 >> (56 - 8 * i));
            all[count][8 + i] = (uint8_t)(hash.low64 >> (56 - 8 * i));
        }
        count++;
    }
    const XXH128_hash_t joined = XXH3_128bits(all, count * sizeof *all);
    return (struct kiln_hash){joined.high64, joined.low64};
}

static void test_hash_is_as_defined(void **state)
{
    (void)state;
    static const size_t sizes[] = {0, 1, PIECE - 1, PIECE, PIECE + 1, 3 * PIECE, BYTES};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (int threads = 1; threads <= 3; threads += 2) {
            const int file = make_file(sizes[s]);
            struct kiln_hash hash = {0}, whole = {0};
            const XXH128_hash_t plain = XXH3_128bits(content, sizes[s]);
            omp_set_num_threads(threads);
            assert_int_equal(kiln_piece_hash_file(file, "file", sizes[s], PIECE, &hash, NULL), 0);
            assert_int_equal(kiln_piece_hash_file(file, "file", sizes[s], UINT64_MAX, &whole, NULL), 0);
            assert_true(whole.high == plain.high64 && whole.low == plain.low64);
            const struct kiln_hash wanted = sizes[s] > PIECE ? expected(sizes[s]) : whole;
            assert_true(hash.high == wanted.high && hash.low == wanted.low);
            (void)close(file);
        }
}

static void test_a_short_file_is_told(void **state)
{
    (void)state;
    struct kiln_hash hash;
    struct kiln_error error = {{0}};
    const int file = make_file(PIECE + 100);
    for (int i = 0; i < 200; i++) { /* whichever thread comes first */
        omp_set_num_threads(1 + i % 4);
        assert_int_equal(kiln_piece_hash_file(file, "short", 9 * PIECE, PIECE, &hash, &error), KILN_IO);
        assert_non_null(strstr(error.message, "'short' ended at byte 65636"));
    }
    (void)close(file);
}

/* The manifest of one file, f, with these words about its hash. */
static int parse(const char *words, struct kiln_manifest **manifest)
{
    char json[512], *text = NULL;
    size_t size = 0;
    (void)snprintf(json, sizeof json, "{\"kiln\": \"x\", \"files\": [{\"path\": \"f\", \"bytes\": %d, %s}]}", BYTES,
                   words);
    json_t *root = json_loads(json, 0, NULL);
    assert_non_null(root);
    assert_int_equal(kiln_seal(root, 0, &text, &size, "test", NULL), 0);
    json_decref(root);
    const int status = kiln_manifest_parse(manifest, "manifest", text, size, NULL);
    kiln_free(&text);
    return status;
}

static void test_manifests_with_pieces(void **state)
{
    (void)state;
    struct kiln_manifest *manifest = NULL;
    char text[KILN_HASH_TEXT], words[256];
    const struct kiln_hash hash = expected(BYTES);
    kiln_hash_text(hash.high, hash.low, text);
    const int file = make_file(BYTES);
    (void)snprintf(words, sizeof words, "\"xxh3_128_of_pieces\": \"%s\", \"piece\": %d", text, PIECE);
    assert_int_equal(parse(words, &manifest), 0);
    assert_int_equal(kiln_manifest_compare(&manifest->files[0], file, "f", NULL), 0);
    for (size_t at = 17; at < BYTES; at += 5 * PIECE) { /* a flipped bit, in this piece and that */
        const uint8_t flipped = content[at] ^ 4u;
        assert_int_equal(pwrite(file, &flipped, 1, (off_t)at), 1);
        assert_int_equal(kiln_manifest_compare(&manifest->files[0], file, "f", NULL), KILN_BAD_INPUT);
        assert_int_equal(pwrite(file, &content[at], 1, (off_t)at), 1);
    }
    kiln_manifest_destroy(&manifest);
    (void)snprintf(words, sizeof words, "\"xxh3_128_of_pieces\": \"%s\", \"piece\": 1", text);
    assert_int_equal(parse(words, &manifest), KILN_BAD_INPUT);
    (void)snprintf(words, sizeof words, "\"xxh3_128_of_pieces\": \"%s\"", text);
    assert_int_equal(parse(words, &manifest), KILN_BAD_INPUT);
    (void)close(file);
}

int main(int argc, char **argv)
{
    if (argc > 1 && strcmp(argv[1], KILN_JSON_CHILD) == 0) /* which reads manifests */
        return kiln_foreign_json_child(argc, argv, NULL);
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_hash_is_as_defined),
                                       cmocka_unit_test(test_a_short_file_is_told),
                                       cmocka_unit_test(test_manifests_with_pieces)};
    return cmocka_run_group_tests(tests, set_up, NULL);
}
