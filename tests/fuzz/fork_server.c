/* The program as a fork server, so that a hundred mutated inputs a second can be given to a build with sanitizers: each
 * command runs in a fork of a process that has loaded its libraries already, and has MPI started with `--mpi`.
 *
 * On standard input one request after the other, each a sequence of strings that end with a zero byte:
 *   SECONDS LEAKS FAILING FOLDER COUNT ARGUMENT...    (COUNT arguments; the first is "kiln")
 * Where the first argument is the path of a program instead, that is executed: from a process this small its memory is
 * measured right. The command runs with FOLDER/out and FOLDER/err as its output and errors and FOLDER/tmp as TMPDIR.
 * SECONDS is its limit of wall-clock time; LEAKS is 1 when leaks shall be looked for at its end; the FAILING-th
 * allocation of each of its processes fails (0: none), of those that kiln's own code asks for: the linker's --wrap does
 * not reach into shared libraries. The answer is one line on standard output: KIND NUMBER SECONDS CPU_SECONDS KIBIBYTES
 * ALLOCATIONS KIND is "exit" (NUMBER: status), "signal" (NUMBER: which), "time" or "memory" (killed at the limit).
 * KIBIBYTES is the most that one process of it held, ALLOCATIONS how many its own code asked for, at most in one of its
 * processes.
 *
 * What the command would do with other processes is done by forks too, which the linker's --wrap brings about
 * (tests/CMakeLists.txt): posix_spawn calls kiln_main in the child instead of loading the program again.
 * MPI_Init_thread and MPI_Finalize do nothing where MPI runs already, and MPI_Abort ends this process alone; fsync does
 * nothing. All else is the program as it is. */
#include <errno.h>
#include <fcntl.h>
#include <hdf5.h>
#include <mpi.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/cli/commands.h"

#if defined(__has_feature)
#    if __has_feature(address_sanitizer)
#        define __SANITIZE_ADDRESS__ /* as GCC says it */
#    endif
#endif
#if defined(__SANITIZE_ADDRESS__)
#    include <sanitizer/lsan_interface.h>
#else
static int __lsan_do_recoverable_leak_check(void) { return 0; }
#endif

enum { ARGUMENTS_MOST = 64, ACTIONS_MOST = 16, STRING_SIZE = 16384, LEAK_STATUS = 99 };
#define MEMORY_LIMIT_KIB (3l << 20) /* of what counts as resident: guards the machine, says nothing of the goal */

/* ---- memory ---- */

/* Shared with the commands' processes. */
static struct {
    long failing, most;
} * memory;
static long allocations; /* of this process */

static bool fails(void)
{
    const long mine = __atomic_add_fetch(&allocations, 1, __ATOMIC_RELAXED);
    if (memory == NULL)
        return false;
    if (mine > memory->most)
        memory->most = mine;
    if (mine != memory->failing)
        return false;
    errno = ENOMEM;
    return true;
}

void *__real_malloc(size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_malloc(size_t size) { return fails() ? NULL : __real_malloc(size); }

void *__real_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_calloc(size_t count, size_t size) { return fails() ? NULL : __real_calloc(count, size); }

void *__real_realloc(void *old, size_t size);
void *__wrap_realloc(void *old, size_t size);
void *__wrap_realloc(void *old, size_t size) { return fails() ? NULL : __real_realloc(old, size); }

void *__real_aligned_alloc(size_t alignment, size_t size);
void *__wrap_aligned_alloc(size_t alignment, size_t size);
void *__wrap_aligned_alloc(size_t alignment, size_t size)
{
    return fails() ? NULL : __real_aligned_alloc(alignment, size);
}

char *__real_strdup(const char *text);
char *__wrap_strdup(const char *text);
char *__wrap_strdup(const char *text) { return fails() ? NULL : __real_strdup(text); }

static void run_main(char **arguments, bool leaks)
{
    int count = 0;
    while (arguments[count] != NULL)
        count++;
    int status = kiln_main(count, arguments);
    (void)fflush(NULL);
    if (leaks && __lsan_do_recoverable_leak_check() != 0)
        status = LEAK_STATUS;
    _exit(status);
}

/* ---- posix_spawn by fork: the actions are noted as they are added, for one call at a time ---- */

static struct {
    enum { DUP2, OPEN, CLOSE_FROM } kind;
    int from, to;
    const char *path;
    int flags;
    mode_t mode;
} noted[ACTIONS_MOST];
static size_t noted_count;

int __wrap_posix_spawn_file_actions_init(posix_spawn_file_actions_t *actions);
int __real_posix_spawn_file_actions_init(posix_spawn_file_actions_t *actions);
int __wrap_posix_spawn_file_actions_init(posix_spawn_file_actions_t *actions)
{
    noted_count = 0;
    return __real_posix_spawn_file_actions_init(actions);
}

int __wrap_posix_spawn_file_actions_adddup2(posix_spawn_file_actions_t *actions, int from, int to);
int __wrap_posix_spawn_file_actions_adddup2(posix_spawn_file_actions_t *actions, int from, int to)
{
    (void)actions;
    if (noted_count == ACTIONS_MOST)
        return ENOMEM;
    noted[noted_count].kind = DUP2;
    noted[noted_count].from = from;
    noted[noted_count++].to = to;
    return 0;
}

int __wrap_posix_spawn_file_actions_addopen(posix_spawn_file_actions_t *actions, int to, const char *path, int flags,
                                            mode_t mode);
int __wrap_posix_spawn_file_actions_addopen(posix_spawn_file_actions_t *actions, int to, const char *path, int flags,
                                            mode_t mode)
{
    (void)actions;
    if (noted_count == ACTIONS_MOST)
        return ENOMEM;
    noted[noted_count].kind = OPEN;
    noted[noted_count].to = to;
    noted[noted_count].path = path; /* literals, as all callers give */
    noted[noted_count].flags = flags;
    noted[noted_count++].mode = mode;
    return 0;
}

int __wrap_posix_spawn_file_actions_addclosefrom_np(posix_spawn_file_actions_t *actions, int from);
int __wrap_posix_spawn_file_actions_addclosefrom_np(posix_spawn_file_actions_t *actions, int from)
{
    (void)actions;
    if (noted_count == ACTIONS_MOST)
        return ENOMEM;
    noted[noted_count].kind = CLOSE_FROM;
    noted[noted_count++].from = from;
    return 0;
}

static void do_noted(void)
{
    for (size_t i = 0; i < noted_count; i++) {
        if (noted[i].kind == CLOSE_FROM) {
            (void)close_range((unsigned)noted[i].from, ~0u, 0);
            continue;
        }
        const int descriptor =
            noted[i].kind == DUP2 ? noted[i].from : open(noted[i].path, noted[i].flags, noted[i].mode);
        if (descriptor < 0 || dup2(descriptor, noted[i].to) < 0)
            _exit(127);
        if (noted[i].kind == OPEN && descriptor != noted[i].to)
            (void)close(descriptor);
    }
}

int __wrap_posix_spawn(pid_t *pid, const char *path, const posix_spawn_file_actions_t *actions,
                       const posix_spawnattr_t *attributes, char *const argv[], char *const envp[]);
int __wrap_posix_spawn(pid_t *pid, const char *path, const posix_spawn_file_actions_t *actions,
                       const posix_spawnattr_t *attributes, char *const argv[], char *const envp[])
{
    (void)path, (void)actions, (void)attributes, (void)envp;
    (void)fflush(NULL);
    *pid = fork();
    if (*pid < 0)
        return errno;
    if (*pid == 0) {
        allocations = 0;
        do_noted();
        run_main((char **)(uintptr_t)argv, false);
    }
    return 0;
}

/* ---- MPI, once ---- */

static bool mpi_runs;

int __real_MPI_Init_thread(int *argc, char ***argv, int required, int *provided);
int __wrap_MPI_Init_thread(int *argc, char ***argv, int required, int *provided);
int __wrap_MPI_Init_thread(int *argc, char ***argv, int required, int *provided)
{
    if (!mpi_runs)
        return __real_MPI_Init_thread(argc, argv, required, provided);
    *provided = required;
    return MPI_SUCCESS;
}

int __real_MPI_Finalize(void);
int __wrap_MPI_Finalize(void);
int __wrap_MPI_Finalize(void) { return mpi_runs ? MPI_SUCCESS : __real_MPI_Finalize(); }

int __real_MPI_Abort(MPI_Comm communicator, int code);
int __wrap_MPI_Abort(MPI_Comm communicator, int code);
int __wrap_MPI_Abort(MPI_Comm communicator, int code)
{
    if (mpi_runs)
        _exit(code); /* what runs is the server's, and would be waited for */
    return __real_MPI_Abort(communicator, code);
}

int __wrap_fsync(int descriptor);
int __wrap_fsync(int descriptor) { return fcntl(descriptor, F_GETFD) < 0 ? -1 : 0; }

/* The program's own bytes are hashed at each import, and are many in this build. */
XXH64_hash_t __real_XXH3_64bits(const void *bytes, size_t size);
XXH64_hash_t __wrap_XXH3_64bits(const void *bytes, size_t size);
static size_t program_size;
XXH64_hash_t __wrap_XXH3_64bits(const void *bytes, size_t size)
{
    return size == program_size ? 1 : __real_XXH3_64bits(bytes, size);
}

/* ---- requests ---- */

static bool read_string(char *text, size_t size)
{
    for (size_t i = 0; i < size; i++) {
        const int c = getchar();
        if (c == EOF)
            return false;
        text[i] = (char)c;
        if (c == '\0')
            return true;
    }
    (void)fprintf(stderr, "fork server: a string of a request is longer than %zu bytes\n", size);
    exit(1);
}

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Returns the memory that a process holds, KiB. */
static long resident(pid_t pid)
{
    char path[64];
    long pages = 0, held = 0;
    (void)snprintf(path, sizeof path, "/proc/%d/statm", (int)pid);
    FILE *file = fopen(path, "re");
    if (file == NULL)
        return 0;
    if (fscanf(file, "%ld %ld", &pages, &held) != 2)
        held = 0;
    (void)fclose(file);
    return held * (sysconf(_SC_PAGESIZE) / 1024);
}

/* The first child of a process; 0: none. */
static pid_t child_of(pid_t pid)
{
    char path[64];
    int child = 0;
    (void)snprintf(path, sizeof path, "/proc/%d/task/%d/children", (int)pid, (int)pid);
    FILE *file = fopen(path, "re");
    if (file == NULL)
        return 0;
    if (fscanf(file, "%d", &child) != 1)
        child = 0;
    (void)fclose(file);
    return child;
}

static void put_streams(const char *folder)
{
    static const struct {
        const char *name;
        int descriptor, flags;
    } streams[] = {{"/dev/null", 0, O_RDONLY},
                   {"out", 1, O_WRONLY | O_CREAT | O_TRUNC | O_APPEND},
                   {"err", 2, O_WRONLY | O_CREAT | O_TRUNC | O_APPEND}};
    char path[STRING_SIZE + 8];
    for (size_t i = 0; i < 3; i++) {
        (void)snprintf(path, sizeof path, "%s%s%s", i == 0 ? "" : folder, i == 0 ? "" : "/", streams[i].name);
        const int descriptor = open(path, streams[i].flags, 0600);
        if (descriptor < 0 || dup2(descriptor, streams[i].descriptor) < 0)
            _exit(126);
        (void)close(descriptor);
    }
    (void)close_range(3, ~0u, CLOSE_RANGE_CLOEXEC); /* MPI's are used */
    (void)snprintf(path, sizeof path, "%s/tmp", folder);
    (void)setenv("TMPDIR", path, 1);
}

/* Waits for the command, or ends it with all its processes; the answer's first word. */
static const char *watch(pid_t pid, double limit)
{
    const int handle = (int)syscall(SYS_pidfd_open, pid, 0);
    const double start = now();
    const char *why = NULL;
    struct pollfd wait = {.fd = handle, .events = POLLIN};
    while (why == NULL && poll(&wait, 1, 50) == 0) {
        const pid_t child = child_of(pid);
        if (now() - start > limit)
            why = "time";
        else if (resident(pid) > MEMORY_LIMIT_KIB || (child > 0 && resident(child) > MEMORY_LIMIT_KIB))
            why = "memory";
    }
    (void)close(handle);
    (void)kill(-pid, SIGKILL); /* what it left behind, too */
    return why;
}

static void serve(char **arguments, double limit, bool leaks, long failing, const char *folder)
{
    const double start = now();
    struct rusage used;
    int state = 0;
    memory->most = memory->failing = 0;
    const pid_t pid = fork();
    if (pid < 0) {
        perror("fork server: fork");
        exit(1);
    }
    if (pid == 0) {
        (void)setpgid(0, 0);
        (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
        put_streams(folder);
        allocations = 0;
        memory->failing = failing;
        if (arguments[0][0] == '/') {
            (void)execv(arguments[0], arguments);
            _exit(127);
        }
        run_main(arguments, leaks);
    }
    (void)setpgid(pid, pid);
    const char *why = watch(pid, limit);
    while (wait4(pid, &state, 0, &used) < 0 && errno == EINTR)
        ;
    const double cpu = (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
                       1e-6 * (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
    (void)printf("%s %d %.4f %.4f %ld %ld\n",
                 why != NULL          ? why
                 : WIFSIGNALED(state) ? "signal"
                                      : "exit",
                 WIFSIGNALED(state) ? WTERMSIG(state) : WEXITSTATUS(state), now() - start, cpu, used.ru_maxrss,
                 memory->most);
    (void)fflush(stdout);
}

static bool serve_next(void)
{
    static char words[ARGUMENTS_MOST + 5][STRING_SIZE];
    char *arguments[ARGUMENTS_MOST + 1] = {NULL};
    for (size_t i = 0; i < 5; i++)
        if (!read_string(words[i], sizeof words[i]))
            return false;
    const long count = strtol(words[4], NULL, 10);
    if (count < 1 || count > ARGUMENTS_MOST)
        return false;
    for (long i = 0; i < count; i++) {
        if (!read_string(words[5 + i], sizeof words[5 + i]))
            return false;
        arguments[i] = words[5 + i];
    }
    serve(arguments, strtod(words[0], NULL), words[1][0] == '1', strtol(words[2], NULL, 10), words[3]);
    return true;
}

static size_t size_of_program(void)
{
    const int file = open("/proc/self/exe", O_RDONLY | O_CLOEXEC);
    const off_t size = file >= 0 ? lseek(file, 0, SEEK_END) : 0;
    if (file >= 0)
        (void)close(file);
    return size > 0 ? (size_t)size : 0;
}

int main(int argc, char **argv)
{
    int provided = 0;
    program_size = size_of_program();
    memory = mmap(NULL, sizeof *memory, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED) {
        perror("fork server: mmap");
        return 1;
    }
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    (void)setvbuf(stdin, NULL, _IOFBF, 1 << 16);
    (void)H5open();
    if (argc > 1 && strcmp(argv[1], "--mpi") == 0) {
        (void)setenv("OMPI_MCA_ess_singleton_isolated", "1", 0);
        (void)setenv("OMPI_MCA_sharedfp", "individual", 0);
        if (__real_MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &provided) != MPI_SUCCESS)
            return 1;
        mpi_runs = true;
    }
    while (serve_next())
        ;
    if (mpi_runs)
        (void)__real_MPI_Finalize();
    return 0;
}
