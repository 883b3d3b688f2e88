/* Fault injection by LD_PRELOAD: makes the K-th call of a kind fail, of the calls that kiln's own code makes in its
 * main thread.
 *
 * KILN_FAULT=RANK:KIND:K in the environment says which; KILN_FAULT_COUNTS=FOLDER has each rank write there at its end
 * how many calls of each kind it made.
 *
 *   allocation  malloc, aligned_alloc, ...     gives NULL
 *   window      memfd_create, posix_fallocate, mmap: no memory
 *   file        open, fopen, write, fsync, rename, ...   no space left, or an I/O error
 *   thread      pthread_create, of any library and thread: no more threads
 *   astray      at the K-th allocation the rank waits in MPI for a message that nobody sends
 *   asleep      at the K-th allocation its main thread goes to sleep for ever
 */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <link.h>
#include <mpi.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

enum kind { ALLOCATION, WINDOW, FILE_CALL, THREAD, KINDS };
static const char *const names[KINDS] = {"allocation", "window", "file", "thread"};

static struct {
    uintptr_t begin, end; /* of the program's code and data */
    bool ready, astray, asleep;
    enum kind kind;
    long at; /* 0: nothing fails */
    long counts[KINDS];
} state;

static int note_program(struct dl_phdr_info *info, size_t size, void *data)
{
    (void)size;
    (void)data;
    state.begin = UINTPTR_MAX;
    for (int i = 0; i < info->dlpi_phnum; i++) {
        const ElfW(Phdr) *header = &info->dlpi_phdr[i];
        const uintptr_t first = info->dlpi_addr + header->p_vaddr, after = first + header->p_memsz;
        if (header->p_type != PT_LOAD)
            continue;
        state.begin = first < state.begin ? first : state.begin;
        state.end = after > state.end ? after : state.end;
    }
    return 1; /* the program is the first */
}

static void read_fault(void)
{
    const char *text = getenv("KILN_FAULT"), *own = getenv("OMPI_COMM_WORLD_RANK");
    char kind[32] = "";
    int rank;
    long at;
    if (text == NULL || own == NULL || sscanf(text, "%d:%31[a-z]:%ld", &rank, kind, &at) != 3 || rank != atoi(own))
        return;
    for (int k = 0; k < KINDS; k++)
        if (strcmp(kind, names[k]) == 0) {
            state.kind = (enum kind)k;
            state.at = at;
        }
    state.astray = strcmp(kind, "astray") == 0;
    state.asleep = strcmp(kind, "asleep") == 0;
    if (state.astray || state.asleep)
        state.at = at;
}

__attribute__((constructor)) static void begin(void)
{
    (void)dl_iterate_phdr(note_program, NULL);
    read_fault();
    (void)unsetenv("LD_PRELOAD"); /* not for children */
    state.ready = true;
}

__attribute__((destructor)) static void end(void)
{
    char path[4096];
    const char *folder = getenv("KILN_FAULT_COUNTS"), *own = getenv("OMPI_COMM_WORLD_RANK");
    state.ready = false;
    if (folder == NULL || own == NULL)
        return;
    (void)snprintf(path, sizeof path, "%s/%s", folder, own);
    FILE *file = fopen(path, "w");
    for (int k = 0; k < KINDS && file != NULL; k++)
        (void)fprintf(file, "%s %ld\n", names[k], state.counts[k]);
    if (file != NULL)
        (void)fclose(file);
}

static bool is_own(const void *caller)
{
    return state.ready && (uintptr_t)caller >= state.begin && (uintptr_t)caller < state.end && gettid() == getpid();
}

static void stray(void)
{
    char none;
    state.ready = false;
    if (state.astray)
        (void)MPI_Recv(&none, 1, MPI_CHAR, 0, 77, MPI_COMM_SELF, MPI_STATUS_IGNORE);
    for (;;)
        (void)pause();
}

/* Whether this call is the one. */
static bool fails(enum kind kind, bool counts)
{
    if (!counts || !state.ready)
        return false;
    const long count = __atomic_add_fetch(&state.counts[kind], 1, __ATOMIC_RELAXED);
    if (count != state.at || kind != state.kind)
        return false;
    if (state.astray || state.asleep)
        stray();
    static const char text[] = "fault: here\n";
    (void)!write(STDERR_FILENO, text, sizeof text - 1);
    return true;
}

/* The library's function, looked up once. */
#define NEXT(name)                                                                                                     \
    static __typeof__(name) *next;                                                                                     \
    if (next == NULL) {                                                                                                \
        void *found = dlsym(RTLD_NEXT, #name);                                                                         \
        memcpy(&next, &found, sizeof next);                                                                            \
    }
#define HERE is_own(__builtin_return_address(0))

/* ---- memory: glibc's own names, for dlsym allocates ---- */

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);

static void *none(void)
{
    errno = ENOMEM;
    return NULL;
}

void *malloc(size_t size) { return fails(ALLOCATION, HERE) ? none() : __libc_malloc(size); }
void *calloc(size_t count, size_t size) { return fails(ALLOCATION, HERE) ? none() : __libc_calloc(count, size); }
void *realloc(void *old, size_t size) { return fails(ALLOCATION, HERE) ? none() : __libc_realloc(old, size); }
void *aligned_alloc(size_t alignment, size_t size)
{
    return fails(ALLOCATION, HERE) ? none() : __libc_memalign(alignment, size);
}

/* ---- what ranks share ---- */

static int lack(int number)
{
    errno = number;
    return -1;
}

int memfd_create(const char *name, unsigned flags)
{
    NEXT(memfd_create)
    return fails(WINDOW, HERE) ? lack(ENOMEM) : next(name, flags);
}

int posix_fallocate(int descriptor, off_t offset, off_t length)
{
    NEXT(posix_fallocate)
    return fails(WINDOW, HERE) ? ENOSPC : next(descriptor, offset, length);
}

void *mmap(void *address, size_t length, int protection, int flags, int descriptor, off_t offset)
{
    NEXT(mmap)
    if (fails(WINDOW, HERE))
        return lack(ENOMEM), MAP_FAILED;
    return next(address, length, protection, flags, descriptor, offset);
}

/* ---- threads ---- */

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*start)(void *), void *data)
{
    NEXT(pthread_create)
    return fails(THREAD, true) ? EAGAIN : next(thread, attributes, start, data);
}

/* ---- files ---- */

int open(const char *path, int flags, ...)
{
    NEXT(open)
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = (flags & (O_CREAT | __O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
    va_end(arguments);
    return fails(FILE_CALL, HERE) ? lack(EIO) : next(path, flags, mode);
}

int openat(int folder, const char *path, int flags, ...)
{
    NEXT(openat)
    va_list arguments;
    va_start(arguments, flags);
    const mode_t mode = (flags & (O_CREAT | __O_TMPFILE)) != 0 ? va_arg(arguments, mode_t) : 0;
    va_end(arguments);
    return fails(FILE_CALL, HERE) ? lack(EIO) : next(folder, path, flags, mode);
}

FILE *fopen(const char *path, const char *mode)
{
    NEXT(fopen)
    return fails(FILE_CALL, HERE) ? lack(EIO), NULL : next(path, mode);
}

ssize_t read(int descriptor, void *bytes, size_t count)
{
    NEXT(read)
    return fails(FILE_CALL, HERE) ? lack(EIO) : next(descriptor, bytes, count);
}

ssize_t pread(int descriptor, void *bytes, size_t count, off_t offset)
{
    NEXT(pread)
    return fails(FILE_CALL, HERE) ? lack(EIO) : next(descriptor, bytes, count, offset);
}

ssize_t write(int descriptor, const void *bytes, size_t count)
{
    NEXT(write)
    return descriptor > 2 && fails(FILE_CALL, HERE) ? lack(ENOSPC) : next(descriptor, bytes, count);
}

ssize_t pwrite(int descriptor, const void *bytes, size_t count, off_t offset)
{
    NEXT(pwrite)
    return fails(FILE_CALL, HERE) ? lack(ENOSPC) : next(descriptor, bytes, count, offset);
}

int fsync(int descriptor)
{
    NEXT(fsync)
    return fails(FILE_CALL, HERE) ? lack(EIO) : next(descriptor);
}

int rename(const char *from, const char *to)
{
    NEXT(rename)
    return fails(FILE_CALL, HERE) ? lack(ENOSPC) : next(from, to);
}

int mkdir(const char *path, mode_t mode)
{
    NEXT(mkdir)
    return fails(FILE_CALL, HERE) ? lack(ENOSPC) : next(path, mode);
}
