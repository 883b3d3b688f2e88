#include "coordinator/mpi/shared_memory.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

enum { SPARE_BYTES = 16 << 20 }; /* kept free for other processes */

/* Whether the machine has that much memory. All pages are allocated at once, and a process that exhausts memory is
 * killed by the kernel. */
static bool is_available(uint64_t bytes)
{
    char line[128];
    unsigned long long kibibytes = 0;
    bool found = false;
    FILE *file = fopen("/proc/meminfo", "re");
    while (file != NULL && !found && fgets(line, sizeof line, file) != NULL)
        found = sscanf(line, "MemAvailable: %llu kB", &kibibytes) == 1;
    if (file != NULL)
        (void)fclose(file);
    return !found || kibibytes * 1024 >= bytes + SPARE_BYTES;
}

static int failed(uint64_t bytes, const char *what, struct kiln_error *error)
{
    return kiln_fail_errno(error, KILN_SYSTEM, "shared memory of %llu bytes for the ranks of this host cannot be %s",
                           (unsigned long long)bytes, what);
}

static int map(void **memory, int descriptor, uint64_t bytes, struct kiln_error *error)
{
    void *at = mmap(NULL, (size_t)bytes, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (at == MAP_FAILED)
        return failed(bytes, "mapped", error);
    *memory = at;
    return KILN_OK;
}

/* Allocates all pages now, and continues after signals. */
static int allocate_pages(int descriptor, uint64_t bytes)
{
    int problem;
    do
        problem = posix_fallocate(descriptor, 0, (off_t)bytes);
    while (problem == EINTR);
    errno = problem;
    return problem;
}

int kiln_shared_make(void **memory, struct kiln_shared_key *key, uint64_t bytes, struct kiln_error *error)
{
    struct stat file;
    int status = KILN_OK;
    *memory = NULL;
    *key = (struct kiln_shared_key){0};
    if (!is_available(bytes))
        return kiln_fail(error, KILN_SYSTEM,
                         "shared memory of %llu bytes for the ranks of this host is more than the host has left",
                         (unsigned long long)bytes);
    const int descriptor = memfd_create("kiln", MFD_CLOEXEC);
    if (descriptor < 0)
        return failed(bytes, "created", error);
    if (allocate_pages(descriptor, bytes) != 0 || fstat(descriptor, &file) != 0)
        status = failed(bytes, "allocated", error);
    if (status == KILN_OK)
        status = map(memory, descriptor, bytes, error);
    if (status != KILN_OK) {
        (void)close(descriptor);
        return status;
    }
    *key = (struct kiln_shared_key){getpid(), descriptor, (uint64_t)file.st_dev, (uint64_t)file.st_ino, bytes};
    return KILN_OK;
}

void kiln_shared_seal(struct kiln_shared_key *key)
{
    if (key->bytes != 0)
        (void)close((int)key->descriptor);
    *key = (struct kiln_shared_key){0};
}

int kiln_shared_open(void **memory, const struct kiln_shared_key *key, struct kiln_error *error)
{
    char path[64];
    struct stat file;
    int status = KILN_OK;
    *memory = NULL;
    (void)snprintf(path, sizeof path, "/proc/%lld/fd/%lld", (long long)key->process, (long long)key->descriptor);
    const int descriptor = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (descriptor < 0)
        return failed(key->bytes, "opened", error);
    if (fstat(descriptor, &file) != 0)
        status = failed(key->bytes, "opened", error);
    else if ((uint64_t)file.st_dev != key->device || (uint64_t)file.st_ino != key->inode ||
             (uint64_t)file.st_size != key->bytes)
        status = kiln_fail(error, KILN_SYSTEM,
                           "%s is not the shared memory of the ranks of this host; check that they see each other's "
                           "processes in /proc",
                           path);
    if (status == KILN_OK)
        status = map(memory, descriptor, key->bytes, error);
    (void)close(descriptor);
    return status;
}

void kiln_shared_release(void **memory, uint64_t bytes)
{
    if (*memory != NULL)
        (void)munmap(*memory, (size_t)bytes);
    *memory = NULL;
}
