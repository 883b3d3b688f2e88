#include "coordinator/import/confine.h"
#include "coordinator/import/import.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/openat2.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <xxhash.h>

#include "worker/base/calls.h"
#include "worker/base/memory.h"

enum { PATH_LENGTH = 1024, SHOWN = 80 }; /* SHOWN: how many bytes of a name from the file a sentence repeats */

static int copy_string(char **target, const char *text, size_t length, struct kiln_error *error)
{
    const int status = kiln_allocate(target, length + 1, 1, "a path", error);
    if (status == KILN_OK)
        memcpy(*target, text, length);
    return status;
}

int kiln_confine_create(struct kiln_confine **result, const char *path, struct kiln_error *error)
{
    struct kiln_confine *confine = NULL;
    char *real = NULL;
    int status = kiln_allocate(&confine, 1, sizeof *confine, "the scene's folder", error);
    if (status != KILN_OK)
        return status;
    confine->scene = path;
    confine->descriptor = -1;
    real = realpath(path, NULL);
    if (real == NULL) {
        status = kiln_fail_errno(error, errno == ENOTDIR || errno == ENAMETOOLONG || errno == ELOOP ? KILN_NO_INPUT : 0,
                                 "%.512s: the scene cannot be opened", path);
        goto done;
    }
    const char *slash = strrchr(real, '/');
    status = copy_string(&confine->folder, real, slash == real ? 1 : (size_t)(slash - real), error);
    if (status == KILN_OK)
        status = copy_string(&confine->name, slash + 1, strlen(slash + 1), error);
    if (status != KILN_OK)
        goto done;
    confine->descriptor = kiln_open(confine->folder, O_PATH | O_DIRECTORY | O_CLOEXEC, 0);
    if (confine->descriptor < 0)
        status = kiln_fail_errno(error, 0, "%.512s: the scene's folder cannot be opened", path);
done:
    free(real);
    if (status != KILN_OK)
        kiln_confine_destroy(&confine);
    *result = confine;
    return status;
}

void kiln_confine_destroy(struct kiln_confine **pointer)
{
    struct kiln_confine *confine = *pointer;
    if (confine == NULL)
        return;
    if (confine->descriptor >= 0)
        (void)close(confine->descriptor);
    kiln_free(&confine->folder);
    kiln_free(&confine->name);
    kiln_free(&confine->seen);
    kiln_free(pointer);
}

static int hex(char c)
{
    if (c >= '0' && c <= '9')
        return c - '0';
    c = (char)(c | 0x20);
    return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

static bool has_scheme(const char *uri)
{
    if (!((uri[0] | 0x20) >= 'a' && (uri[0] | 0x20) <= 'z'))
        return false;
    const size_t length = strspn(uri, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+.-");
    return uri[length] == ':';
}

static bool has_parent_step(const char *path)
{
    for (const char *p = path; *p != '\0';) {
        const size_t length = strcspn(p, "/\\"); /* kiln_confine_find takes either */
        if (length == 2 && p[0] == '.' && p[1] == '.')
            return true;
        p += length;
        p += *p != '\0';
    }
    return false;
}

int kiln_confine_decode(const struct kiln_confine *confine, const char *uri, const char *place, char path[1025],
                        struct kiln_error *error)
{
    if (has_scheme(uri))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.512s: %s is '%.*s'; only files in the scene's own folder are read: copy it there and use a "
                         "relative path",
                         confine->scene, place, SHOWN, uri);
    size_t length = 0;
    for (const char *c = uri; *c != '\0'; c++) {
        char byte = *c;
        if (*c == '%') {
            const int high = hex(c[1]), low = high < 0 ? -1 : hex(c[2]);
            if (low < 0 || high * 16 + low == 0)
                return kiln_fail(
                    error, KILN_BAD_INPUT,
                    "%.512s: %s is '%.*s', which has a bad percent code; write %%XX with two hexadecimal digits",
                    confine->scene, place, SHOWN, uri);
            byte = (char)(high * 16 + low);
            c += 2;
        }
        if (length == PATH_LENGTH)
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%.512s: %s is longer than %d bytes ('%.*s...'); use a shorter file name", confine->scene,
                             place, PATH_LENGTH, SHOWN, uri);
        path[length++] = byte;
    }
    path[length] = '\0';
    if (length == 0)
        return kiln_fail(error, KILN_BAD_INPUT, "%.512s: %s is empty; name a file", confine->scene, place);
    if (path[0] == '/' || path[0] == '\\' || has_parent_step(path))
        return kiln_fail(
            error, KILN_BAD_INPUT,
            "%.512s: %s is '%.*s', which leads out of the scene's folder; copy the file there and use a relative path",
            confine->scene, place, SHOWN, uri);
    return KILN_OK;
}

int kiln_confine_open(const struct kiln_confine *confine, const char *path, int flags)
{
    const struct open_how how = {.flags = (uint64_t)(unsigned)(O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | flags),
                                 .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS};
    long descriptor;
    do
        descriptor = syscall(SYS_openat2, confine->descriptor, path, &how, sizeof how);
    /* EAGAIN: a file was renamed while the kernel resolved the path */
    while (descriptor < 0 && (errno == EAGAIN || errno == EINTR));
    return (int)descriptor;
}

static int open_failed(const struct kiln_confine *confine, const char *path, const char *place,
                       struct kiln_error *error)
{
    switch (errno) {
    case EXDEV:
    case ELOOP:
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.512s: %s: '%.*s' is a link that leads out of the scene's folder; copy the file there",
                         confine->scene, place, SHOWN, path);
    case ENOENT:
    case ENOTDIR:
    case ENAMETOOLONG:
        return kiln_fail_errno(error, KILN_BAD_INPUT, "%.512s: %s: '%.*s' is missing in the scene's folder",
                               confine->scene, place, SHOWN, path);
    case ENXIO:
    case ENODEV:
        return kiln_fail_errno(error, KILN_BAD_INPUT, "%.512s: %s: '%.*s' is not a regular file", confine->scene, place,
                               SHOWN, path);
    case ENOSYS:
        return kiln_fail(error, KILN_SITE,
                         "%.512s: this kernel has no openat2(2), with which kiln confines a scene to its folder; Linux "
                         "5.6 or later is needed",
                         confine->scene);
    default:
        return kiln_fail_errno(error, 0, "%.512s: %s: '%.*s' cannot be opened", confine->scene, place, SHOWN, path);
    }
}

static uint64_t *seen_slot(const struct kiln_confine *confine, const uint64_t key[2])
{
    size_t slot = (size_t)key[0] & (confine->seen_size - 1);
    while ((confine->seen[slot][0] | confine->seen[slot][1]) != 0 &&
           memcmp(confine->seen[slot], key, sizeof confine->seen[slot]) != 0)
        slot = (slot + 1) & (confine->seen_size - 1);
    return confine->seen[slot];
}

static int seen_grow(struct kiln_confine *confine, struct kiln_error *error)
{
    struct kiln_confine old = *confine;
    confine->seen = NULL;
    confine->seen_size = old.seen_size == 0 ? 64 : 2 * old.seen_size;
    const int status =
        kiln_allocate(&confine->seen, confine->seen_size, sizeof *confine->seen, "the scene's files", error);
    if (status != KILN_OK) {
        *confine = old;
        return status;
    }
    for (size_t i = 0; i < old.seen_size; i++)
        if ((old.seen[i][0] | old.seen[i][1]) != 0)
            memcpy(seen_slot(confine, old.seen[i]), old.seen[i], sizeof old.seen[i]);
    kiln_free(&old.seen);
    return KILN_OK;
}

/* Enters the hash of `bytes` into the table; *fresh tells whether it is new. */
static int remember(struct kiln_confine *confine, const void *bytes, size_t size, bool *fresh, struct kiln_error *error)
{
    const XXH128_hash_t hash = XXH3_128bits(bytes, size);
    const uint64_t key[2] = {hash.low64, hash.high64};
    const int status = 2 * (confine->seen_used + 1) > confine->seen_size ? seen_grow(confine, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    uint64_t *slot = seen_slot(confine, key);
    *fresh = (slot[0] | slot[1]) == 0;
    confine->seen_used += *fresh;
    memcpy(slot, key, sizeof key);
    return KILN_OK;
}

static int map_descriptor(struct kiln_confine *confine, int descriptor, const char *path, const char *place,
                          struct kiln_file *file, struct kiln_error *error)
{
    static const unsigned char nothing[1];
    struct stat status;
    if (fstat(descriptor, &status) != 0)
        return kiln_fail_errno(error, KILN_IO, "%.512s: %s: '%.*s' cannot be examined", confine->scene, place, SHOWN,
                               path);
    if (!S_ISREG(status.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "%.512s: %s: '%.*s' is not a regular file", confine->scene, place,
                         SHOWN, path);
    file->data = nothing;
    file->size = (size_t)status.st_size;
    if (file->size == 0)
        return KILN_OK;
    void *map = mmap(NULL, file->size, PROT_READ, MAP_PRIVATE, descriptor, 0);
    if (map == MAP_FAILED) {
        file->size = 0;
        return kiln_fail_errno(error, KILN_SYSTEM, "%.512s: %s: the %lld bytes of '%.*s' cannot be mapped",
                               confine->scene, place, (long long)status.st_size, SHOWN, path);
    }
    file->data = map;
    const uint64_t identity[2] = {(uint64_t)status.st_dev, (uint64_t)status.st_ino};
    bool fresh = false;
    const int result = remember(confine, identity, sizeof identity, &fresh, error);
    confine->total_bytes += fresh ? file->size : 0;
    if (fresh && confine->mapped != NULL)
        confine->mapped(confine);
    return result;
}

static int record_source(struct kiln_confine *confine, struct kiln_builder *builder, const char *path,
                         const struct kiln_file *file, struct kiln_error *error)
{
    bool fresh = false;
    int status = builder == NULL ? KILN_OK : remember(confine, path, strlen(path), &fresh, error);
    if (status != KILN_OK || !fresh)
        return status;
    const XXH128_hash_t hash = XXH3_128bits(file->data, file->size);
    struct kiln_source source = {.size = file->size, .hash = {hash.low64, hash.high64}};
    status = kiln_builder_string(builder, path, PATH_MAX, &source.path, error);
    return status != KILN_OK ? status : kiln_builder_append(builder, KILN_SECTION_SOURCES, &source, 1, NULL, error);
}

static bool says_missing(int number) { return number == ENOENT || number == ENOTDIR || number == ENAMETOOLONG; }

bool kiln_confine_is_missing(const struct kiln_confine *confine, const char *path)
{
    const int descriptor = kiln_confine_open(confine, path, 0);
    const bool missing = descriptor < 0 && says_missing(errno);
    if (descriptor >= 0)
        (void)close(descriptor);
    return missing;
}

int kiln_confine_record_missing(struct kiln_confine *confine, struct kiln_builder *builder, const char *path,
                                struct kiln_error *error)
{
    struct kiln_source source = {.size = KILN_SOURCE_MISSING};
    bool fresh = false;
    int status;
    KILN_TRY(remember(confine, path, strlen(path), &fresh, error));
    if (fresh)
        KILN_TRY(kiln_builder_string(builder, path, PATH_MAX, &source.path, error));
    if (fresh)
        KILN_TRY(kiln_builder_append(builder, KILN_SECTION_SOURCES, &source, 1, NULL, error));
end:
    return status;
}

int kiln_confine_map(struct kiln_confine *confine, struct kiln_builder *builder, const char *path, const char *place,
                     struct kiln_file *file, struct kiln_error *error)
{
    *file = (struct kiln_file){0};
    const int descriptor = kiln_confine_open(confine, path, 0);
    if (descriptor < 0)
        return open_failed(confine, path, place, error);
    int status = map_descriptor(confine, descriptor, path, place, file, error);
    (void)close(descriptor);
    if (status == KILN_OK)
        status = record_source(confine, builder, path, file, error);
    if (status != KILN_OK)
        kiln_file_unmap(file);
    return status;
}

int kiln_confine_map_named(struct kiln_confine *confine, struct kiln_builder *builder, const char *path,
                           struct kiln_file *file, struct kiln_error *error)
{
    *file = (struct kiln_file){0};
    char *real = realpath(path, NULL);
    if (real == NULL)
        return kiln_fail_errno(error, KILN_NO_INPUT, "%.512s: the file cannot be opened", path);
    int status;
    const int descriptor = kiln_open(real, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0);
    if (descriptor < 0) {
        status = kiln_fail_errno(error, 0, "%.512s: the file cannot be opened", path);
    } else {
        status = map_descriptor(confine, descriptor, path, "the environment", file, error);
        (void)close(descriptor);
    }
    if (status == KILN_OK)
        status = record_source(confine, builder, real, file, error);
    if (status != KILN_OK)
        kiln_file_unmap(file);
    free(real);
    return status;
}

void kiln_file_unmap(struct kiln_file *file)
{
    if (file->size > 0)
        (void)munmap((void *)(uintptr_t)file->data, file->size);
    *file = (struct kiln_file){0};
}
