#include "coordinator/confined/fence.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sched.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

void kiln_fence_limit(int resource, uint64_t value)
{
    struct rlimit now;
    if (getrlimit((__rlimit_resource_t)resource, &now) != 0)
        return;
    now.rlim_cur = now.rlim_max != RLIM_INFINITY && now.rlim_max < value ? now.rlim_max : (rlim_t)value;
    (void)setrlimit((__rlimit_resource_t)resource, &now);
}

void kiln_fence_begin(void)
{
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    kiln_fence_limit(RLIMIT_CORE, 0);
}

/* Returns the private writable memory, bytes, as the kernel counts it for RLIMIT_DATA. The file is opened once, before
 * the filter forbids opening. */
static uint64_t data_bytes(void)
{
    static int descriptor = -1;
    unsigned long long pages[6] = {0};
    char text[256];
    if (descriptor < 0)
        descriptor = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    const ssize_t got = descriptor < 0 ? -1 : pread(descriptor, text, sizeof text - 1, 0);
    if (got <= 0)
        return 0;
    text[got] = '\0';
    if (sscanf(text, "%llu %llu %llu %llu %llu %llu", &pages[0], &pages[1], &pages[2], &pages[3], &pages[4],
               &pages[5]) != 6)
        return 0;
    return (uint64_t)pages[5] * (uint64_t)sysconf(_SC_PAGESIZE);
}

void kiln_fence_limits(uint64_t bytes, uint64_t seconds)
{
    struct rusage used;
    const uint64_t has = data_bytes();
    if (!KILN_ADDRESS_SANITIZER && has > 0) /* AddressSanitizer reserves terabytes */
        kiln_fence_limit(RLIMIT_DATA, has + bytes);
    if (getrusage(RUSAGE_SELF, &used) == 0)
        kiln_fence_limit(RLIMIT_CPU, (uint64_t)used.ru_utime.tv_sec + (uint64_t)used.ru_stime.tv_sec + 1 + seconds);
}

#if defined(__x86_64__)
#    define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#    define ARCHITECTURE AUDIT_ARCH_AARCH64
#endif

#ifdef ARCHITECTURE
#    define ALLOW(name)                                                                                                \
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_##name, 0, 1), BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW)
#    define REFUSE(name, number)                                                                                       \
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_##name, 0, 1), BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | (number))

/* The seccomp filter. It allows what the C library, OpenMP, HDF5, OpenEXR and zlib need to work on memory and open
 * descriptors; anything else fails with EPERM. */
static struct sock_filter calls[] = {
    BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, arch)),
    BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0),
    BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
    BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
    ALLOW(read),
    ALLOW(pread64),
    ALLOW(readv),
    ALLOW(write),
    ALLOW(pwrite64),
    ALLOW(writev),
    ALLOW(lseek),
    ALLOW(close),
    ALLOW(dup),
    ALLOW(fcntl),
    ALLOW(flock),
    ALLOW(fstat),
    ALLOW(newfstatat),
    ALLOW(ftruncate),
    ALLOW(recvmsg),
    ALLOW(sendmsg),
    ALLOW(recvfrom),
    ALLOW(sendto),
    ALLOW(mmap),
    ALLOW(munmap),
    ALLOW(mremap),
    ALLOW(mprotect),
    ALLOW(madvise),
    ALLOW(brk),
    ALLOW(getrandom),
    ALLOW(futex),
    ALLOW(sched_yield),
    ALLOW(sched_getaffinity),
    ALLOW(set_robust_list),
    ALLOW(rseq),
    ALLOW(set_tid_address),
    ALLOW(restart_syscall),
    ALLOW(rt_sigaction),
    ALLOW(rt_sigprocmask),
    ALLOW(rt_sigreturn),
    ALLOW(sigaltstack),
    ALLOW(tgkill),
    ALLOW(gettid),
    ALLOW(getpid),
    ALLOW(getppid),
    ALLOW(clock_gettime),
    ALLOW(clock_nanosleep),
    ALLOW(nanosleep),
    ALLOW(gettimeofday),
    ALLOW(getrusage),
    ALLOW(prlimit64),
    ALLOW(sysinfo),
    ALLOW(uname),
    ALLOW(getuid),
    ALLOW(geteuid),
    ALLOW(getgid),
    ALLOW(getegid),
    ALLOW(exit),
    ALLOW(exit_group),
#    ifdef SYS_getrlimit
    ALLOW(getrlimit),
    ALLOW(setrlimit),
#    endif
    /* clone3 has its flags in memory, where the filter cannot see them; when it fails, the C library uses clone */
    REFUSE(clone3, ENOSYS),
    BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_clone, 0, 3), /* threads only, no processes */
    BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, args[0])),
    BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, CLONE_THREAD, 0, 1),
    BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
};
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the low half of an argument comes first");

void kiln_fence_calls(void)
{
    const struct sock_fprog program = {.len = sizeof calls / sizeof *calls, .filter = calls};
    (void)data_bytes(); /* opens the file that it reads later */
    /* The sanitizer needs files and its symbolizer for reports. */
    if (!KILN_ADDRESS_SANITIZER && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0)
        (void)prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
}
#else
void kiln_fence_calls(void) { (void)data_bytes(); }
#endif
