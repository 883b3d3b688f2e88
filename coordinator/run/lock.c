#include "coordinator/run/lock.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/run/status_file.h"
#include "coordinator/files/foreign_json.h"
#include "coordinator/files/json.h"
#include "coordinator/files/left_behind.h"
#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

#define LEASE_SECONDS 15.0 /* lease of a holder on another host, on a file system without locks */
#define WATCH_SECONDS 3.0

enum { TEXT_MOST = 4096, TRIES = 20, BUSY_TRIES = 6 };

static const char NAME[] = ".kiln.lock";

struct kiln_lock {
    struct kiln_folder folder;
    int descriptor;
    bool locks; /* the file system has locks */
    struct kiln_left *left;
    char aside[128];
};

/* The holder of the lock, as the file describes it. */
struct holder {
    char host[64], boot[40], command[200];
    int64_t process, since;
    uint64_t started;
    bool locks;
};

static void pause_for(double seconds)
{
    const struct timespec time = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};
    (void)nanosleep(&time, NULL);
}

/* ---- the holder ---- */

/* Reads the first line of a small file. With `words`, as for a command line in /proc, the whole text with zero bytes
 * replaced by spaces. */
static void read_text(const char *path, bool words, char *text, size_t size)
{
    FILE *file = fopen(path, "re");
    size_t length = file != NULL ? fread(text, 1, size - 1, file) : 0;
    if (file != NULL)
        (void)fclose(file);
    while (length > 0 && (text[length - 1] == '\n' || text[length - 1] == '\0'))
        length--;
    text[length] = '\0';
    for (size_t i = 0; i < length; i++)
        if ((unsigned char)text[i] < ' ' || text[i] == 0x7f)
            text[i] = words && text[i] == '\0' ? ' ' : '?';
}

static void describe_self(struct holder *self, bool locks)
{
    struct kiln_bake_status sign = {0};
    kiln_bake_status_sign(&sign);
    *self =
        (struct holder){.process = sign.process, .started = sign.started, .since = (int64_t)time(NULL), .locks = locks};
    (void)snprintf(self->host, sizeof self->host, "%s", sign.host);
    read_text("/proc/sys/kernel/random/boot_id", false, self->boot, sizeof self->boot);
    read_text("/proc/self/cmdline", true, self->command, sizeof self->command);
}

static int write_self(int descriptor, bool locks, const char *path, struct kiln_error *error)
{
    struct holder self;
    describe_self(&self, locks);
    json_t *json =
        json_pack("{s:o, s:s, s:I, s:I, s:I, s:o, s:b}", "host", kiln_json_string(self.host), "boot", self.boot,
                  "process", (json_int_t)self.process, "started", (json_int_t)self.started, "since",
                  (json_int_t)self.since, "command", kiln_json_string(self.command), "locks", (int)locks);
    char *text = json != NULL ? json_dumps(json, JSON_COMPACT) : NULL;
    json_decref(json);
    const int status = text != NULL ? kiln_write_all(descriptor, text, strlen(text), 0, path, error)
                                    : kiln_fail(error, KILN_SYSTEM, "out of memory: the lock of a bake's folder");
    free(text);
    return status;
}

static void take_text(const json_t *json, const char *key, char *text, size_t size)
{
    const char *value = json_string_value(json_object_get(json, key));
    (void)snprintf(text, size, "%s", value != NULL ? value : "");
    for (; *text != '\0'; text++) /* anybody may have written the file: keep control characters out of messages */
        if ((unsigned char)*text < ' ' || *text == 0x7f)
            *text = '?';
}

static void read_holder(int descriptor, struct holder *holder)
{
    char text[TEXT_MOST];
    *holder = (struct holder){0};
    const ssize_t length = pread(descriptor, text, sizeof text, 0);
    json_t *json = NULL;
    if (length > 0)
        (void)kiln_foreign_json(&json, KILN_JSON_CHILD, text, (size_t)length, NAME, NULL);
    take_text(json, "host", holder->host, sizeof holder->host);
    take_text(json, "boot", holder->boot, sizeof holder->boot);
    take_text(json, "command", holder->command, sizeof holder->command);
    holder->process = json_integer_value(json_object_get(json, "process"));
    holder->started = (uint64_t)json_integer_value(json_object_get(json, "started"));
    holder->since = json_integer_value(json_object_get(json, "since"));
    holder->locks = json_is_true(json_object_get(json, "locks"));
    json_decref(json);
}

static int refuse(const char *directory, const struct holder *holder, struct kiln_error *error)
{
    char since[32] = "some time";
    struct tm local;
    const time_t begun = (time_t)holder->since;
    if (holder->since > 0 && localtime_r(&begun, &local) != NULL)
        (void)strftime(since, sizeof since, "%Y-%m-%d %H:%M:%S", &local);
    return kiln_fail(error, KILN_CANNOT_CREATE,
                     "another bake is at work in %.500s (process %lld on %s, since %s: %s): wait for it, end it with "
                     "'kiln stop %.500s', or choose another folder",
                     directory, (long long)holder->process, holder->host[0] != '\0' ? holder->host : "?", since,
                     holder->command[0] != '\0' ? holder->command : "?", directory);
}

/* ---- locks of the file system ---- */

enum { GOT, LOCKED, NO_LOCKS };

static int set_lock(int descriptor, short type)
{
    struct flock whole = {.l_type = type, .l_whence = SEEK_SET};
    int result;
    do
        result = fcntl(descriptor, F_OFD_SETLK, &whole);
    while (result != 0 && errno == EINTR);
    return result == 0 ? GOT : errno == EAGAIN || errno == EACCES ? LOCKED : NO_LOCKS;
}

static bool same_file(const struct stat *a, const struct stat *b)
{
    return a->st_dev == b->st_dev && a->st_ino == b->st_ino;
}

/* Whether the open file is the one with the name of the lock. */
static bool is_named(const struct kiln_folder *folder, int descriptor)
{
    struct stat own, there;
    return fstat(descriptor, &own) == 0 && fstatat(folder->descriptor, NAME, &there, AT_SYMLINK_NOFOLLOW) == 0 &&
           same_file(&own, &there);
}

/* ---- leases ---- */

static int open_lock(const struct kiln_folder *folder, int flags)
{
    return kiln_openat(folder->descriptor, NAME, flags | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK, 0666);
}

/* Watches the lock for `seconds`; true if it is renewed or replaced. The file is opened again each time, so that
 * network file systems ask their server. */
static bool is_renewed(const struct kiln_folder *folder, const struct stat *judged, double seconds)
{
    for (double waited = 0.0; waited < seconds; waited += 0.25) {
        struct stat now;
        pause_for(0.25);
        const int descriptor = open_lock(folder, O_RDONLY);
        const bool there = descriptor >= 0 && fstat(descriptor, &now) == 0;
        if (descriptor >= 0)
            (void)close(descriptor);
        if (!there)
            return false;
        if (!same_file(judged, &now) || now.st_mtim.tv_sec != judged->st_mtim.tv_sec ||
            now.st_mtim.tv_nsec != judged->st_mtim.tv_nsec)
            return true;
    }
    return false;
}

/* Whether the holder is alive, as far as can be told without a lock. `free_lock`: this process could lock the file. */
static bool is_alive(const struct kiln_folder *folder, const struct holder *holder, const struct stat *judged,
                     bool free_lock)
{
    struct holder self;
    describe_self(&self, true);
    const bool here = strcmp(self.host, holder->host) == 0, same_boot = here && strcmp(self.boot, holder->boot) == 0;
    if (free_lock && holder->locks && here)
        return false;
    if (same_boot && holder->process > 0 && kiln_process_started(holder->process) == holder->started)
        return true;
    return is_renewed(folder, judged, here || free_lock ? WATCH_SECONDS : LEASE_SECONDS);
}

/* Renames an expired lock and removes it; renames it back if another process has replaced it in the meantime. */
static void remove_stale(const struct kiln_lock *lock, const struct stat *judged)
{
    const int folder = lock->folder.descriptor;
    char stale[sizeof lock->aside + 8];
    struct stat moved;
    (void)snprintf(stale, sizeof stale, "%s.old", lock->aside);
    if (kiln_renameat(folder, NAME, stale) != 0)
        return;
    if (fstatat(folder, stale, &moved, AT_SYMLINK_NOFOLLOW) == 0 && !same_file(&moved, judged))
        (void)linkat(folder, stale, folder, NAME, 0);
    (void)kiln_unlinkat(folder, stale, 0);
}

/* ---- taking ---- */

/* Moves the lock to a descriptor that is open for reading only, since a file open for writing would prevent its file
 * system from being remounted read-only. The lock is a read lock then, which also excludes write locks. */
static void keep_for_reading(struct kiln_lock *lock)
{
    const int reads = kiln_openat(lock->folder.descriptor, lock->aside, O_RDONLY | O_NOFOLLOW | O_CLOEXEC, 0);
    if (reads >= 0 &&
        (!lock->locks || (set_lock(lock->descriptor, F_RDLCK) == GOT && set_lock(reads, F_RDLCK) == GOT))) {
        (void)close(lock->descriptor);
        lock->descriptor = reads;
    } else if (reads >= 0) {
        (void)close(reads);
    }
}

static int make_own(struct kiln_lock *lock, bool no_locks, struct kiln_error *error)
{
    char host[64] = "", path[KILN_PATH_SIZE];
    (void)gethostname(host, sizeof host - 1);
    for (char *c = host; *c != '\0'; c++)
        if (*c == '/')
            *c = '_';
    (void)snprintf(lock->aside, sizeof lock->aside, "%s.%s.%ld", NAME, host, (long)getpid());
    int status = kiln_path_join(path, lock->folder.path, NAME, error);
    if (status != KILN_OK)
        return status;
    (void)kiln_unlinkat(lock->folder.descriptor, lock->aside, 0);
    lock->left = kiln_left_note(lock->folder.descriptor, lock->aside);
    lock->descriptor =
        kiln_openat(lock->folder.descriptor, lock->aside, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    if (lock->descriptor < 0)
        return kiln_fail_errno(error,
                               errno == EACCES || errno == EPERM ? KILN_PERMISSION
                               : errno == ENOENT                 ? KILN_NO_INPUT
                                                                 : KILN_CANNOT_CREATE,
                               "'%s' cannot be created", path);
    lock->locks = !no_locks && set_lock(lock->descriptor, F_WRLCK) == GOT;
    status = write_self(lock->descriptor, lock->locks, path, error);
    if (status == KILN_OK)
        keep_for_reading(lock);
    return status;
}

/* Links our file to the name of the lock; true if that succeeded. On a network file system the reply may be lost, so
 * after a failure the link count decides. *number receives errno. */
static bool link_own(const struct kiln_lock *lock, int *number)
{
    struct stat own;
    const int folder = lock->folder.descriptor;
    bool linked = linkat(folder, lock->aside, folder, NAME, 0) == 0;
    *number = linked ? 0 : errno;
    linked =
        linked || (fstat(lock->descriptor, &own) == 0 && own.st_nlink > 1 && is_named(&lock->folder, lock->descriptor));
    if (!linked && *number != EEXIST &&
        *number != ENOENT) { /* the file system has no links: create the file under its final name */
        const int made = open_lock(&lock->folder, O_RDWR | O_CREAT | O_EXCL);
        *number = made < 0 ? errno : 0;
        linked = made >= 0 && kiln_renameat(folder, lock->aside, NAME) == 0; /* replaces that empty file */
        if (made >= 0)
            (void)close(made);
    }
    return linked;
}

enum verdict { TAKEN, BUSY, AGAIN };

/* Decides whether an existing lock can be taken over, and does so. */
static enum verdict try_existing(const struct kiln_lock *lock, int descriptor, struct holder *holder)
{
    struct stat judged;
    const int folder = lock->folder.descriptor, state = lock->locks ? set_lock(descriptor, F_WRLCK) : NO_LOCKS;
    read_holder(descriptor, holder);
    if (state == LOCKED)
        return BUSY;
    if (fstat(descriptor, &judged) != 0 || !is_named(&lock->folder, descriptor))
        return AGAIN;
    if (is_alive(&lock->folder, holder, &judged, state == GOT))
        return BUSY;
    if (state == GOT) /* we hold a write lock, so nobody else may replace it */
        return is_named(&lock->folder, descriptor) && kiln_renameat(folder, lock->aside, NAME) == 0 ? TAKEN : AGAIN;
    remove_stale(lock, &judged);
    return AGAIN;
}

static int look_at_other(const struct kiln_lock *lock, enum verdict *verdict, struct holder *holder,
                         struct kiln_error *error)
{
    struct stat found;
    *verdict = AGAIN;
    const int descriptor = open_lock(&lock->folder, O_RDWR);
    if (descriptor < 0 && errno == ENOENT)
        return KILN_OK;
    if (descriptor < 0 && errno == EACCES) { /* it belongs to another user */
        *holder = (struct holder){0};
        *verdict = BUSY;
        return KILN_OK;
    }
    if (descriptor < 0 || fstat(descriptor, &found) != 0 || !S_ISREG(found.st_mode)) {
        if (descriptor >= 0)
            (void)close(descriptor);
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "'%s/%s' is not a regular file; remove it, or choose another folder", lock->folder.path, NAME);
    }
    *verdict = try_existing(lock, descriptor, holder);
    (void)close(descriptor);
    return KILN_OK;
}

static int take(struct kiln_lock *lock, struct kiln_error *error)
{
    struct holder holder = {0};
    int busy = 0, number = 0;
    for (int i = 0; i < TRIES; i++) {
        enum verdict verdict;
        if (link_own(lock, &number))
            return KILN_OK;
        if (number != EEXIST)
            break;
        const int status = look_at_other(lock, &verdict, &holder, error);
        if (status != KILN_OK || verdict == TAKEN)
            return status;
        if (verdict == BUSY && ++busy >= BUSY_TRIES) /* try again, since a job may just be ending */
            return refuse(lock->folder.path, &holder, error);
        pause_for(0.1);
    }
    errno = number;
    return number == EEXIST
               ? refuse(lock->folder.path, &holder, error)
               : kiln_fail_errno(error, KILN_CANNOT_CREATE, "'%s/%s' cannot be created", lock->folder.path, NAME);
}

/* Whether a temporary file is of a process of this host that is dead: `own` is this process' own. */
static bool is_of_dead(const char *name, const char *own)
{
    const size_t length = (size_t)(strrchr(own, '.') + 1 - own);
    return strncmp(name, own, length) == 0 && kiln_process_started(strtoll(name + length, NULL, 10)) == 0;
}

/* Removes temporary files of killed processes: those of this host, and those older than a minute by the file server's
 * clock. */
static void sweep(const struct kiln_lock *lock)
{
    struct stat own, found;
    const int copy = kiln_openat(lock->folder.descriptor, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
    DIR *entries = copy < 0 ? NULL : fdopendir(copy);
    if (entries == NULL && copy >= 0)
        (void)close(copy);
    if (entries == NULL || fstat(lock->descriptor, &own) != 0)
        goto end;
    for (const struct dirent *entry; (entry = readdir(entries)) != NULL;)
        if (strncmp(entry->d_name, NAME, sizeof NAME - 1) == 0 && entry->d_name[sizeof NAME - 1] == '.' &&
            fstatat(lock->folder.descriptor, entry->d_name, &found, AT_SYMLINK_NOFOLLOW) == 0 &&
            (found.st_mtim.tv_sec + 60 < own.st_mtim.tv_sec || is_of_dead(entry->d_name, lock->aside)))
            (void)kiln_unlinkat(lock->folder.descriptor, entry->d_name, 0);
end:
    if (entries != NULL)
        (void)closedir(entries);
}

int kiln_lock_take(struct kiln_lock **result, const char *directory, bool no_locks, struct kiln_error *error)
{
    struct kiln_lock *lock = NULL;
    *result = NULL;
    int status = kiln_allocate(&lock, 1, sizeof *lock, "the lock of a bake's folder", error);
    if (status != KILN_OK)
        return status;
    lock->descriptor = -1;
    KILN_TRY(kiln_folder_open(&lock->folder, directory, NULL, false, error));
    KILN_TRY(make_own(lock, no_locks, error));
    KILN_TRY(take(lock, error));
end:
    if (lock->folder.descriptor >= 0 && lock->aside[0] != '\0')
        (void)kiln_unlinkat(lock->folder.descriptor, lock->aside, 0);
    kiln_left_forget(&lock->left);
    if (status == KILN_OK) {
        if (lock->locks) /* else another process may have taken it over when a signal ends this one */
            lock->left = kiln_left_note(lock->folder.descriptor, NAME);
        sweep(lock);
        *result = lock;
        return KILN_OK;
    }
    if (lock->descriptor >= 0)
        (void)close(lock->descriptor);
    kiln_folder_close(&lock->folder);
    kiln_free(&lock);
    return status;
}

void kiln_lock_release(struct kiln_lock **pointer)
{
    struct kiln_lock *lock = *pointer;
    if (lock == NULL)
        return;
    if (is_named(&lock->folder, lock->descriptor))
        (void)kiln_unlinkat(lock->folder.descriptor, NAME, 0);
    kiln_left_forget(&lock->left);
    (void)close(lock->descriptor);
    kiln_folder_close(&lock->folder);
    kiln_free(pointer);
}

void kiln_lock_beat(const struct kiln_lock *lock) { (void)futimens(lock->descriptor, NULL); }

int kiln_lock_check(const struct kiln_lock *lock, struct kiln_error *error)
{
    if (is_named(&lock->folder, lock->descriptor))
        return KILN_OK;
    return kiln_fail(error, KILN_IO,
                     "the folder %s was taken over by another bake while this one was stopped, or its %s was removed: "
                     "this bake writes nothing more there; run the same command again when the other has ended",
                     lock->folder.path, NAME);
}

int kiln_lock_refuse(const char *directory, struct kiln_error *error)
{
    struct kiln_folder folder;
    struct holder holder;
    struct stat judged;
    struct flock whole = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    int status = kiln_folder_open(&folder, directory, NULL, false, NULL) == KILN_OK ? KILN_OK : KILN_NO_INPUT;
    const int descriptor = status == KILN_OK ? open_lock(&folder, O_RDONLY) : -1;
    status = KILN_OK;
    if (descriptor >= 0 && fstat(descriptor, &judged) == 0 && S_ISREG(judged.st_mode)) {
        read_holder(descriptor, &holder);
        const bool told = fcntl(descriptor, F_OFD_GETLK, &whole) == 0;
        if (told && holder.locks ? whole.l_type != F_UNLCK : is_alive(&folder, &holder, &judged, false))
            status = refuse(directory, &holder, error);
    }
    if (descriptor >= 0)
        (void)close(descriptor);
    kiln_folder_close(&folder);
    return status;
}
