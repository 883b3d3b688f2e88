/* Guarded buffers: see gpu.h. The memory of one lies so, from low to high addresses:
 *
 *     guard (nobody may touch it) | gap | the buffer | guard        after: the buffer's end is exact
 *     guard                       | the buffer | gap | guard        before: its beginning is */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>
#include <ucontext.h>
#include <unistd.h>

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

enum {
    GUARD_BYTES = 1 << 18 /* a multiple of any page; an index that is one too large usually hits it */,
    ALIGNMENT = 64
};

enum { NOT_YET, BEGUN, DONE };

struct gpu_guard {
    bool before; /* else after */
    size_t page;
    struct gpu_guarded *_Atomic newest;
    struct gpu_buffer marker; /* the device writes here the address of the name of each kernel that it begins */
    bool explains;            /* the handler is this guard's */
    struct sigaction earlier; /* what was to happen at a SIGSEGV */
    atomic_int explaining;    /* NOT_YET, BEGUN, DONE */
};

/* The guard that the signal handler can find: the first one that exists. Faults in others end the process without a
 * message. */
static struct gpu_guard *_Atomic guard_of_handler;

bool gpu_guarded(const struct gpu *gpu) { return gpu->guard != NULL; }

/* ---- the message, by functions that are safe in a signal handler ---- */

struct sentence {
    char text[512];
    size_t length;
};

static void add_text(struct sentence *s, const char *text)
{
    for (; *text != '\0' && s->length + 1 < sizeof s->text; text++)
        s->text[s->length++] = *text;
}

static void add_number(struct sentence *s, uint64_t number)
{
    char digits[24];
    size_t at = sizeof digits;
    digits[--at] = '\0';
    do {
        digits[--at] = (char)('0' + number % 10);
        number /= 10;
    } while (number != 0);
    add_text(s, digits + at);
}

static uintptr_t distance_from(const struct gpu_guarded *g, uintptr_t address)
{
    const uintptr_t start = (uintptr_t)g->start, end = start + g->size;
    return address < start ? start - address : address >= end ? address - end + 1 : 0;
}

static const struct gpu_guarded *nearest_buffer(const struct gpu_guard *guard, uintptr_t address)
{
    const struct gpu_guarded *nearest = NULL;
    for (const struct gpu_guarded *g = atomic_load(&guard->newest); g != NULL; g = g->next)
        if (nearest == NULL || distance_from(g, address) < distance_from(nearest, address))
            nearest = g;
    return nearest;
}

static void add_place(struct sentence *s, const struct gpu_guarded *g, uintptr_t address)
{
    const uintptr_t start = (uintptr_t)g->start;
    if (address < start) {
        add_number(s, start - address);
        add_text(s, " bytes before '");
    } else {
        add_text(s, "byte ");
        add_number(s, address - start);
        add_text(s, " of '");
    }
    add_text(s, g->what);
    add_text(s, "', which has ");
    add_number(s, g->size);
    add_text(s, atomic_load(&g->retired) ? " bytes and has been destroyed" : " bytes");
    if (distance_from(g, address) > GUARD_BYTES)
        add_text(s, " and is the nearest buffer");
}

static const char *deed(const ucontext_t *context)
{
#if defined __x86_64__
    return (context->uc_mcontext.gregs[REG_ERR] & 2) != 0 ? " writes " : " reads ";
#else
    (void)context;
    return " touches ";
#endif
}

static void say_what_happened(const struct gpu_guard *guard, uintptr_t address, const ucontext_t *context)
{
    struct sentence s = {.length = 0};
    const char *kernel = *(const char *const volatile *)guard->marker.mapped;
    add_text(&s, "kiln: error: guard: ");
    add_text(&s, kernel != NULL ? "the kernel '" : "what is no kernel");
    add_text(&s, kernel != NULL ? kernel : "");
    add_text(&s, kernel != NULL ? "'" : "");
    add_text(&s, deed(context));
    if (address == 0)
        add_text(&s, "where no memory can be, as with an address that is 0 or was never written");
    else
        add_place(&s, nearest_buffer(guard, address), address);
    add_text(&s, "\n");
    if (write(STDERR_FILENO, s.text, s.length) < 0)
        return; /* nobody is there to be told */
}

/* Explains a fault. The access is repeated on return, and then ends the process as it would have without this handler.
 * A kernel may fault in several threads at once: the first one prints, and the others wait so that none ends the
 * process before. */
static void explain(int number, siginfo_t *info, void *context)
{
    struct gpu_guard *guard = atomic_load(&guard_of_handler);
    if (guard == NULL)
        return;
    int nobody = NOT_YET;
    if (atomic_compare_exchange_strong(&guard->explaining, &nobody, BEGUN)) {
        say_what_happened(guard, (uintptr_t)info->si_addr, context);
        atomic_store(&guard->explaining, DONE);
    }
    while (atomic_load(&guard->explaining) != DONE)
        (void)nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    (void)sigaction(number, &guard->earlier, NULL);
}

static void begin_to_explain(struct gpu_guard *guard)
{
    struct gpu_guard *nobody = NULL;
    const struct sigaction action = {.sa_sigaction = explain, .sa_flags = SA_SIGINFO};
    guard->explains = atomic_compare_exchange_strong(&guard_of_handler, &nobody, guard) &&
                      sigaction(SIGSEGV, &action, &guard->earlier) == 0;
}

static void end_explaining(struct gpu_guard *guard)
{
    if (!guard->explains)
        return;
    (void)sigaction(SIGSEGV, &guard->earlier, NULL);
    atomic_store(&guard_of_handler, NULL);
}

/* ---- life ---- */

int gpu_guard_create(struct gpu *gpu, struct kiln_error *error)
{
    const enum kiln_buffer_guard wanted = gpu->faults != NULL ? gpu->faults->wanted.guard : KILN_GUARD_NONE;
    if (wanted == KILN_GUARD_NONE)
        return KILN_OK;
    if (!gpu->about.software)
        return kiln_fail(
            error, KILN_NO_DEVICE,
            "guarded buffers were asked for (KILN_VULKAN_GUARD), and only software devices have them: choose one by "
            "--device, %s is a real one",
            gpu->about.name);
    const int status = kiln_allocate(&gpu->guard, 1, sizeof *gpu->guard, "guards of buffers", error);
    if (status != KILN_OK)
        return status;
    gpu->guard->before = wanted == KILN_GUARD_BEFORE;
    gpu->guard->page = (size_t)sysconf(_SC_PAGESIZE);
    gpu->about.ray_tracing = false; /* buffers of acceleration structures need an alignment that guards do not give */
    return KILN_OK;
}

int gpu_guard_start(struct gpu *gpu, struct kiln_error *error)
{
    if (gpu->guard == NULL)
        return KILN_OK;
    const int status =
        gpu_buffer_create(gpu, &gpu->guard->marker, sizeof(const char *), GPU_HOST, "the present kernel's name", error);
    if (status != KILN_OK)
        return status;
    memset(gpu->guard->marker.mapped, 0, sizeof(const char *));
    begin_to_explain(gpu->guard);
    return KILN_OK;
}

void gpu_guard_destroy(struct gpu *gpu)
{
    if (gpu->guard == NULL)
        return;
    end_explaining(gpu->guard);
    gpu_buffer_destroy(gpu, &gpu->guard->marker);
    for (struct gpu_guarded *g = atomic_load(&gpu->guard->newest), *next; g != NULL && !gpu->hangs; g = next) {
        next = g->next;
        (void)mprotect(g->begin - GUARD_BYTES, (size_t)(g->end - g->begin) + 2 * GUARD_BYTES, PROT_READ | PROT_WRITE);
        vkFreeMemory(gpu->device, g->memory, NULL);
        kiln_free(&g);
    }
    kiln_free(&gpu->guard);
}

/* ---- buffers ---- */

static size_t round_up(size_t value, size_t unit) { return (value + unit - 1) / unit * unit; }

size_t gpu_guard_buffer_size(const struct gpu *gpu, size_t size)
{
    return gpu->guard != NULL ? round_up(size, ALIGNMENT) : size;
}

VkDeviceSize gpu_guard_memory_size(const struct gpu *gpu, VkDeviceSize needed)
{
    return gpu->guard != NULL ? round_up(needed, gpu->guard->page) + 2 * GUARD_BYTES + gpu->guard->page : needed;
}

/* Returns the fill byte of a gap at an address: together they form an unlikely number. */
static unsigned char gap_byte(uintptr_t address) { return address % 4 == 3 ? 0xff : 0xa5; }

static void fill(const struct gpu_guarded *g)
{
    for (unsigned char *p = g->begin; p < g->end; p++)
        *p = gap_byte((uintptr_t)p);
    memset(g->start, 0xff, g->size);
}

static void lay_out(const struct gpu_guard *guard, struct gpu_guarded *g, unsigned char *base)
{
    const size_t padded = round_up(g->size, ALIGNMENT), page = guard->page, pages = round_up(padded, page);
    g->begin = base + (round_up((uintptr_t)base, page) - (uintptr_t)base) + GUARD_BYTES;
    g->end = g->begin + pages;
    g->start = guard->before ? g->begin : g->end - g->size;
    g->skip = guard->before ? 0 : padded - g->size;
    g->offset = (VkDeviceSize)(g->start - g->skip - base);
}

int gpu_guard_take(struct gpu *gpu, VkDeviceMemory memory, size_t size, const char *what, struct gpu_guarded **guarded,
                   struct kiln_error *error)
{
    void *base;
    struct gpu_guarded *g = NULL;
    const VkResult result = GPU_TRY(gpu, vkMapMemory(gpu->device, memory, 0, VK_WHOLE_SIZE, 0, &base));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "cannot map the memory of %s, to guard it", what);
    int status = kiln_allocate(&g, 1, sizeof *g, "a guard", error);
    if (status != KILN_OK)
        return status;
    *g = (struct gpu_guarded){.next = atomic_load(&gpu->guard->newest), .memory = memory, .size = size};
    (void)snprintf(g->what, sizeof g->what, "%s", what);
    lay_out(gpu->guard, g, base);
    fill(g);
    if (mprotect(g->begin - GUARD_BYTES, GUARD_BYTES, PROT_NONE) != 0 || mprotect(g->end, GUARD_BYTES, PROT_NONE) != 0)
        status = kiln_fail_errno(
            error, KILN_SYSTEM, "cannot guard the memory of %s (a process may have so many mappings: vm.max_map_count)",
            what);
    atomic_store(&gpu->guard->newest, g); /* also after a failure: freed with the others */
    *guarded = g;
    return status;
}

/* Finds kernels that have written just beyond a buffer's end, where it is not exactly at the guard. */
static void check_gap(const struct gpu_guarded *g)
{
    for (const unsigned char *p = g->begin; p < g->end; p++) {
        if (p == g->start)
            p += g->size;
        if (p < g->end && *p != gap_byte((uintptr_t)p)) {
            (void)fprintf(stderr,
                          "kiln: error: guard: something was written %td bytes after the beginning of '%s', which has "
                          "%zu bytes\n",
                          p - g->start, g->what, g->size);
            abort();
        }
    }
}

void gpu_guard_retire(struct gpu_guarded *g)
{
    check_gap(g);
    atomic_store(&g->retired, true);
    (void)madvise(g->begin, (size_t)(g->end - g->begin), MADV_DONTNEED);
    (void)mprotect(g->begin, (size_t)(g->end - g->begin), PROT_NONE);
}

size_t gpu_buffer_tail(const struct gpu *gpu, const struct gpu_buffer *buffer, size_t size)
{
    return gpu->guard != NULL && !gpu->guard->before ? buffer->size - size : 0;
}

void gpu_buffer_forget(const struct gpu *gpu, const struct gpu_buffer *buffer)
{
    if (gpu->guard != NULL && buffer->size != 0)
        memset((void *)(uintptr_t)buffer->address, 0xff, buffer->size);
}

/* ---- which kernel runs ---- */

void gpu_guard_mark(const struct gpu *gpu, VkCommandBuffer commands, const char *kernel)
{
    if (gpu->guard == NULL || gpu->guard->marker.memory == NULL)
        return;
    gpu_barrier(commands);
    vkCmdUpdateBuffer(commands, gpu_vk_buffer(&gpu->guard->marker), gpu_buffer_skip(&gpu->guard->marker), sizeof kernel,
                      &kernel);
    gpu_barrier(commands);
}
