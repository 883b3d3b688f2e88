/* Compiled kernels in a folder: what was kept comes back, and nothing else does. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/files/kernel_cache.h"
#include "worker/base/memory.h"

static const char KEY[] = "00112233445566778899aabbccddeeff", OTHER[] = "ff112233445566778899aabbccddeeff";
static const char KERNEL[] = "what a driver gave";

struct folder {
    char root[64], kernels[96];
    struct kiln_kernel_store store;
};

static void make(struct folder *f)
{
    (void)snprintf(f->root, sizeof f->root, "/tmp/kiln-kernels-XXXXXX");
    assert_non_null(mkdtemp(f->root));
    (void)snprintf(f->kernels, sizeof f->kernels, "%s/a/b", f->root);
    f->store = kiln_kernel_cache(f->kernels);
}

static void file_of(const struct folder *f, const char *key, char path[160])
{
    (void)snprintf(path, 160, "%s/%s.kernel", f->kernels, key);
}

static void clear(const struct folder *f)
{
    char command[128];
    (void)snprintf(command, sizeof command, "rm -r '%s'", f->root);
    assert_int_equal(system(command), 0);
}

static bool finds(const struct folder *f, const char *key)
{
    size_t size = 0;
    char *bytes = f->store.load(f->store.place, key, &size);
    const bool found = bytes != NULL;
    if (found) {
        assert_int_equal(size, sizeof KERNEL);
        assert_memory_equal(bytes, KERNEL, sizeof KERNEL);
    }
    kiln_free(&bytes);
    return found;
}

static void keep(const struct folder *f, const char *key) { f->store.keep(f->store.place, key, KERNEL, sizeof KERNEL); }

static void what_is_kept_comes_back(void **state)
{
    (void)state;
    struct folder f;
    make(&f);
    assert_false(finds(&f, KEY));
    keep(&f, KEY);
    assert_true(finds(&f, KEY));
    assert_false(finds(&f, OTHER));
    clear(&f);
}

/* Every byte of the file, changed; every shorter file; a longer one. Kept again, it is whole. */
static void damage_is_seen(void **state)
{
    (void)state;
    struct folder f;
    char path[160];
    make(&f);
    keep(&f, KEY);
    file_of(&f, KEY, path);
    const int file = open(path, O_RDWR);
    struct stat found;
    assert_int_equal(fstat(file, &found), 0);
    for (off_t i = 0; i < found.st_size; i++) {
        char byte;
        assert_int_equal(pread(file, &byte, 1, i), 1);
        const char other = (char)(byte ^ 4);
        assert_int_equal(pwrite(file, &other, 1, i), 1);
        assert_false(finds(&f, KEY));
        assert_int_equal(pwrite(file, &byte, 1, i), 1);
        assert_true(finds(&f, KEY));
    }
    assert_int_equal(ftruncate(file, found.st_size + 1), 0);
    assert_false(finds(&f, KEY));
    for (off_t size = found.st_size - 1; size >= 0; size--) {
        assert_int_equal(ftruncate(file, size), 0);
        assert_false(finds(&f, KEY));
    }
    (void)close(file);
    keep(&f, KEY);
    assert_true(finds(&f, KEY));
    clear(&f);
}

static void another_kernels_file_is_not_taken(void **state)
{
    (void)state;
    struct folder f;
    char from[160], to[160];
    make(&f);
    keep(&f, KEY);
    file_of(&f, KEY, from);
    file_of(&f, OTHER, to);
    assert_int_equal(rename(from, to), 0);
    assert_false(finds(&f, OTHER));
    clear(&f);
}

static void nothing_is_kept_where_nothing_can_be(void **state)
{
    (void)state;
    struct folder f;
    char below[160];
    make(&f);
    keep(&f, KEY);
    file_of(&f, KEY, below); /* a file in the place of a folder */
    struct folder g = f;
    g.store = kiln_kernel_cache(below);
    keep(&g, OTHER);
    assert_false(finds(&g, OTHER));
    assert_true(finds(&f, KEY));
    const struct kiln_kernel_store none = kiln_kernel_cache("none");
    assert_true(none.load == NULL && none.keep == NULL);
    clear(&f);
}

static void users_folder(void **state)
{
    (void)state;
    struct folder f;
    char path[192];
    make(&f);
    f.store = kiln_kernel_cache(NULL);
    assert_int_equal(setenv("XDG_CACHE_HOME", "not/absolute", 1), 0);
    assert_int_equal(setenv("HOME", f.root, 1), 0);
    keep(&f, KEY);
    (void)snprintf(path, sizeof path, "%s/.cache/kiln/kernels/%s.kernel", f.root, KEY);
    assert_int_equal(access(path, R_OK), 0);
    assert_int_equal(setenv("XDG_CACHE_HOME", f.root, 1), 0);
    assert_false(finds(&f, KEY));
    keep(&f, KEY);
    (void)snprintf(path, sizeof path, "%s/kiln/kernels/%s.kernel", f.root, KEY);
    assert_int_equal(access(path, R_OK), 0);
    assert_int_equal(unsetenv("XDG_CACHE_HOME"), 0);
    assert_int_equal(unsetenv("HOME"), 0);
    assert_false(finds(&f, KEY));
    keep(&f, KEY); /* goes nowhere */
    clear(&f);
}

/* A file that takes all the room, read so many seconds after 1970; its bytes are holes. */
static void fill(const struct folder *f, const char *key, time_t read)
{
    char path[160];
    const struct timespec times[2] = {{.tv_sec = read}, {.tv_sec = read}};
    file_of(f, key, path);
    const int file = open(path, O_CREAT | O_WRONLY, 0666);
    assert_true(file >= 0 && ftruncate(file, KILN_KERNEL_CACHE_BYTES / 2) == 0 && futimens(file, times) == 0);
    (void)close(file);
}

static bool is_there(const struct folder *f, const char *key)
{
    char path[160];
    file_of(f, key, path);
    return access(path, F_OK) == 0;
}

static void what_was_not_read_for_longest_goes(void **state)
{
    (void)state;
    static const char OLD[] = "11112222333344445555666677778888", OLDER[] = "21112222333344445555666677778888",
                      OLDEST[] = "31112222333344445555666677778888", STRANGE[] = "not a kernel";
    struct folder f;
    make(&f);
    keep(&f, KEY);
    fill(&f, OLD, 3000);
    fill(&f, OLDEST, 1000);
    fill(&f, OLDER, 2000);
    fill(&f, STRANGE, 10);
    keep(&f, OTHER); /* one and a half of the room are taken: two have to go */
    assert_true(is_there(&f, OLD) && !is_there(&f, OLDER) && !is_there(&f, OLDEST));
    assert_true(finds(&f, KEY) && finds(&f, OTHER));
    assert_true(is_there(&f, STRANGE));
    clear(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_kept_comes_back),
        cmocka_unit_test(damage_is_seen),
        cmocka_unit_test(another_kernels_file_is_not_taken),
        cmocka_unit_test(nothing_is_kept_where_nothing_can_be),
        cmocka_unit_test(users_folder),
        cmocka_unit_test(what_was_not_read_for_longest_goes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
