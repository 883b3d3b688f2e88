/* System calls that are repeated when a signal interrupts them (EINTR).
 *
 * POSIX lets open, fsync, rename and similar calls fail with EINTR, which says nothing about the disk. On local file
 * systems this does not happen; on network and user-space file systems it may. close is never repeated: Linux has
 * released the descriptor by then, whatever close returns, and another thread may already have been given it. An
 * interrupted close is not a failure: what must be on disk was synced before. */
#ifndef KILN_WORKER_BASE_CALLS_H
#define KILN_WORKER_BASE_CALLS_H

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <unistd.h>

/* `mode` matters with O_CREAT only. */
static inline int kiln_open(const char *path, int flags, mode_t mode)
{
    int descriptor;
    do
        descriptor = open(path, flags, mode);
    while (descriptor < 0 && errno == EINTR);
    return descriptor;
}

static inline int kiln_fsync(int descriptor)
{
    int result;
    do
        result = fsync(descriptor);
    while (result != 0 && errno == EINTR);
    return result;
}

/* Asks the system to start writing the bytes from `begin` up to `end` to disk, so that a later kiln_fsync waits less.
 * Errors are reported by kiln_fsync. The last, incomplete page is left out, since it may still be written to. */
static inline void kiln_begin_sync(int descriptor, uint64_t begin, uint64_t end)
{
    const uint64_t whole = end & ~(uint64_t)4095;
    if (begin < whole)
        (void)sync_file_range(descriptor, (off_t)begin, (off_t)(whole - begin), SYNC_FILE_RANGE_WRITE);
}

static inline int kiln_close(int descriptor)
{
    const int result = close(descriptor);
    return result != 0 && errno == EINTR ? 0 : result;
}

/* `mode` matters with O_CREAT only. */
static inline int kiln_openat(int folder, const char *name, int flags, mode_t mode)
{
    int descriptor;
    do
        descriptor = openat(folder, name, flags, mode);
    while (descriptor < 0 && errno == EINTR);
    return descriptor;
}

/* Within one folder. */
static inline int kiln_renameat(int folder, const char *from, const char *to)
{
    int result;
    do
        result = renameat(folder, from, folder, to);
    while (result != 0 && errno == EINTR);
    return result;
}

static inline int kiln_unlinkat(int folder, const char *name, int flags)
{
    int result;
    do
        result = unlinkat(folder, name, flags);
    while (result != 0 && errno == EINTR);
    return result;
}

static inline int kiln_truncate(int descriptor, off_t size)
{
    int result;
    do
        result = ftruncate(descriptor, size);
    while (result != 0 && errno == EINTR);
    return result;
}

/* posix_fallocate. Returns 0 or the error number; errno is not set. */
static inline int kiln_fallocate(int descriptor, off_t size)
{
    int result;
    do
        result = posix_fallocate(descriptor, 0, size);
    while (result == EINTR);
    return result;
}

#endif
