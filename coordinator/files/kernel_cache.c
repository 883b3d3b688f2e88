#include "coordinator/files/kernel_cache.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <xxhash.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

#define SUFFIX ".kernel"
#define MARK ".kind"
enum { HEAD = 48, KEY_AT = 8, SIZE_AT = 24, SUM_AT = 32, KEY_BYTES = KILN_KERNEL_KEY / 2, NAME = 64 };
static const char magic[KEY_AT] = {'K', 'I', 'L', 'N', 'K', 'E', 'R', 'N'};

/* ---- names ---- */

static bool find_folder(const char *place, char path[KILN_PATH_SIZE])
{
    const char *cache = getenv("XDG_CACHE_HOME"), *home = getenv("HOME");
    int length = -1;
    if (place != NULL)
        length = snprintf(path, KILN_PATH_SIZE, "%s", place);
    /* relative paths are ignored, as the XDG Base Directory Specification demands */
    else if (cache != NULL && cache[0] == '/')
        length = snprintf(path, KILN_PATH_SIZE, "%s/kiln/kernels", cache);
    else if (home != NULL && home[0] == '/')
        length = snprintf(path, KILN_PATH_SIZE, "%s/.cache/kiln/kernels", home);
    return length > 0 && length < KILN_PATH_SIZE;
}

static bool name_file(const char *folder, const char *key, char path[KILN_PATH_SIZE])
{
    const int length = snprintf(path, KILN_PATH_SIZE, "%s/%s" SUFFIX, folder, key);
    return length > 0 && length < KILN_PATH_SIZE;
}

static bool is_name(const char *name)
{
    return strspn(name, "0123456789abcdef") == KILN_KERNEL_KEY && strcmp(name + KILN_KERNEL_KEY, SUFFIX) == 0;
}

/* ---- a file's head ---- */

static void make_head(const char *key, const void *bytes, size_t size, unsigned char head[HEAD])
{
    const XXH128_hash_t sum = XXH3_128bits(bytes, size);
    const uint64_t values[3] = {size, sum.low64, sum.high64};
    memcpy(head, magic, sizeof magic);
    for (int i = 0; i < KEY_BYTES; i++) {
        unsigned byte = 0;
        (void)sscanf(key + 2 * i, "%2x", &byte);
        head[KEY_AT + i] = (unsigned char)byte;
    }
    for (int i = 0; i < HEAD - SIZE_AT; i++)
        head[SIZE_AT + i] = (unsigned char)(values[i / 8] >> (i % 8 * 8));
}

static bool is_whole(const char *key, const char *bytes, size_t size)
{
    unsigned char head[HEAD];
    if (size <= HEAD)
        return false;
    make_head(key, bytes + HEAD, size - HEAD, head);
    return memcmp(bytes, head, HEAD) == 0;
}

/* ---- the store ---- */

static void *load(const char *place, const char *key, size_t *size)
{
    char folder[KILN_PATH_SIZE], path[KILN_PATH_SIZE], *bytes = NULL;
    size_t length = 0;
    if (!find_folder(place, folder) || !name_file(folder, key, path))
        return NULL;
    const int descriptor = kiln_open(path, O_RDONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC, 0);
    if (descriptor < 0)
        return NULL;
    (void)futimens(descriptor, NULL); /* the file was read now */
    if (kiln_read_descriptor(descriptor, path, KILN_KERNEL_CACHE_BYTES, &bytes, &length, NULL) != KILN_OK)
        return NULL;
    if (!is_whole(key, bytes, length)) {
        kiln_free(&bytes);
        return NULL;
    }
    *size = length - HEAD;
    memmove(bytes, bytes + HEAD, *size);
    return bytes;
}

struct kept_file {
    char name[NAME];
    struct timespec read;
    uint64_t bytes;
};

static int by_time(const void *a, const void *b)
{
    const struct timespec *x = &((const struct kept_file *)a)->read, *y = &((const struct kept_file *)b)->read;
    return x->tv_sec != y->tv_sec ? (x->tv_sec < y->tv_sec ? -1 : 1)
                                  : (x->tv_nsec > y->tv_nsec) - (x->tv_nsec < y->tv_nsec);
}

/* Lists the folder's files; returns the sum of their bytes. */
static uint64_t list_files(DIR *directory, struct kept_file **files, size_t *count)
{
    size_t room = 0;
    uint64_t sum = 0;
    struct stat found;
    for (const struct dirent *entry; (entry = readdir(directory)) != NULL;) {
        if (!is_name(entry->d_name) || fstatat(dirfd(directory), entry->d_name, &found, AT_SYMLINK_NOFOLLOW) != 0 ||
            kiln_grow(files, &room, *count + 1, sizeof **files, "names of kernels", NULL) != KILN_OK)
            continue;
        struct kept_file *file = &(*files)[(*count)++];
        *file = (struct kept_file){.read = found.st_mtim, .bytes = (uint64_t)found.st_size};
        (void)snprintf(file->name, sizeof file->name, "%.*s", NAME - 1, entry->d_name);
        sum += file->bytes;
    }
    return sum;
}

/* Removes the least recently read files until the others are within the limit. */
static void trim(const char *folder)
{
    DIR *directory = opendir(folder);
    struct kept_file *files = NULL;
    size_t count = 0;
    if (directory == NULL)
        return;
    uint64_t sum = list_files(directory, &files, &count);
    if (sum > KILN_KERNEL_CACHE_BYTES)
        qsort(files, count, sizeof *files, by_time);
    for (size_t i = 0; i < count && sum > KILN_KERNEL_CACHE_BYTES; i++) {
        (void)kiln_unlinkat(dirfd(directory), files[i].name, 0);
        sum -= files[i].bytes;
    }
    kiln_free(&files);
    (void)closedir(directory);
}

static void keep(const char *place, const char *key, const void *bytes, size_t size)
{
    char folder[KILN_PATH_SIZE], path[KILN_PATH_SIZE];
    unsigned char head[HEAD];
    struct kiln_publish p;
    int descriptor = -1;
    if (size > KILN_KERNEL_CACHE_BYTES - HEAD || !find_folder(place, folder) || !name_file(folder, key, path) ||
        kiln_make_directories(folder, NULL) != KILN_OK ||
        kiln_publish_claim(&p, NULL, path, &descriptor, NULL) != KILN_OK)
        return;
    make_head(key, bytes, size, head);
    int status;
    KILN_TRY(kiln_write_all(descriptor, head, HEAD, 0, path, NULL));
    KILN_TRY(kiln_write_all(descriptor, bytes, size, HEAD, path, NULL));
    KILN_TRY(kiln_publish_replace(&p, NULL));
end:
    if (status != KILN_OK)
        kiln_publish_abandon(&p);
    (void)kiln_close(descriptor);
    trim(folder);
}

/* ---- marks ---- */

/* False: nothing is kept. */
static bool name_mark(const char *place, const char *kind, char folder[KILN_PATH_SIZE], char path[KILN_PATH_SIZE])
{
    char text[KILN_KERNEL_KIND + 64];
    struct stat program;
    if ((place != NULL && strcmp(place, "none") == 0) || !find_folder(place, folder) ||
        stat("/proc/self/exe", &program) != 0)
        return false;
    (void)snprintf(text, sizeof text, "%lld %lld %s", (long long)program.st_size, (long long)program.st_mtim.tv_sec,
                   kind);
    const XXH128_hash_t hash = XXH3_128bits(text, strlen(text));
    const int length = snprintf(path, KILN_PATH_SIZE, "%s/%016llx%016llx" MARK, folder, (unsigned long long)hash.high64,
                                (unsigned long long)hash.low64);
    return length > 0 && length < KILN_PATH_SIZE;
}

void kiln_kernel_cache_mark(const char *place, const char *kind)
{
    char folder[KILN_PATH_SIZE], path[KILN_PATH_SIZE];
    if (!name_mark(place, kind, folder, path) || kiln_make_directories(folder, NULL) != KILN_OK)
        return;
    const int descriptor = kiln_open(path, O_WRONLY | O_CREAT | O_CLOEXEC, 0666);
    if (descriptor >= 0)
        (void)kiln_close(descriptor);
}

bool kiln_kernel_cache_marked(const char *place, const char *kind)
{
    char folder[KILN_PATH_SIZE], path[KILN_PATH_SIZE];
    return name_mark(place, kind, folder, path) && access(path, F_OK) == 0;
}

/* ---- kernels shipped with the program ---- */

/* The folder of the program, with the slash at its end. */
static bool find_program(char folder[KILN_PATH_SIZE])
{
    const ssize_t length = readlink("/proc/self/exe", folder, KILN_PATH_SIZE - 1);
    if (length <= 0)
        return false;
    folder[length] = '\0';
    char *slash = strrchr(folder, '/');
    if (slash != NULL)
        slash[1] = '\0';
    return slash != NULL;
}

static int read_code(const char *name, size_t most, char **bytes, size_t *size, struct kiln_error *error)
{
    static const char *const places[] = {"", "../lib/kiln/"};
    char folder[KILN_PATH_SIZE], path[KILN_PATH_SIZE];
    int status = find_program(folder) ? KILN_NO_INPUT : KILN_SYSTEM;
    for (size_t i = 0; i < sizeof places / sizeof *places && status == KILN_NO_INPUT; i++) {
        const int length = snprintf(path, sizeof path, "%s%s%s", folder, places[i], name);
        if (length > 0 && length < KILN_PATH_SIZE)
            status = kiln_read_file(path, most, bytes, size, error);
    }
    if (status == KILN_NO_INPUT)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%s is neither in %s nor in %s../lib/kiln: a device without doubles needs the kernels in it; "
                         "install it with kiln again, or use --backend embree",
                         name, folder, folder);
    return status;
}

struct kiln_kernel_store kiln_kernel_cache(const char *folder)
{
    if (folder != NULL && strcmp(folder, "none") == 0)
        return (struct kiln_kernel_store){.file = read_code};
    return (struct kiln_kernel_store){.place = folder, .load = load, .keep = keep, .file = read_code};
}
