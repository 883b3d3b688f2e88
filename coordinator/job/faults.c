#include "coordinator/job/faults.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* The variable's value; NULL where it is not set or empty. */
static const char *value_of(const char *name)
{
    const char *text = getenv(name);
    return text == NULL || text[0] == '\0' ? NULL : text;
}

static int read_slowness(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    int end = 0;
    if (sscanf(text, "%" SCNu32 ":%lf%n", &faults->slow_rank, &faults->slowness, &end) < 2 || text[end] != '\0' ||
        !(faults->slowness >= 1.0 && faults->slowness <= 1e6))
        return kiln_fail(error, KILN_USAGE,
                         "KILN_SLOW_RANK is '%.100s'; it is RANK:FACTOR, and the factor 1 to 1000000", text);
    return KILN_OK;
}

static int read_halt(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    int end = 0;
    if (sscanf(text, "%" SCNu32 ":%n", &faults->halt_rank, &end) < 1 || end == 0 || text[end] == '\0' ||
        strlen(text + end) >= sizeof faults->halt_place)
        return kiln_fail(error, KILN_USAGE,
                         "KILN_HALT_RANK is '%.100s'; it is RANK:PLACE, and the place has 1 to %zu characters", text,
                         sizeof faults->halt_place - 1);
    (void)strcpy(faults->halt_place, text + end);
    return KILN_OK;
}

static int read_hold(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    if (strlen(text) >= sizeof faults->hold)
        return kiln_fail(error, KILN_USAGE, "KILN_HOLD is '%.100s...'; it is a file's path of at most %zu characters",
                         text, sizeof faults->hold - 1);
    (void)strcpy(faults->hold, text);
    return KILN_OK;
}

static int read_packer(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    int end = 0;
    faults->packer_fails = sscanf(text, "%" SCNu32 "%n", &faults->failing_packer, &end) == 1 && text[end] == '\0';
    return faults->packer_fails
               ? KILN_OK
               : kiln_fail(error, KILN_USAGE, "KILN_FAILING_PACKER is '%.100s'; it is the number of a rank", text);
}

static int read_division(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    int end = 0;
    if (sscanf(text, "%" SCNu64 "%n", &faults->divide_from, &end) != 1 || text[end] != '\0' || faults->divide_from == 0)
        return kiln_fail(error, KILN_USAGE, "KILN_DIVIDE_FROM is '%.100s'; it is a number of texels, 1 or more", text);
    return KILN_OK;
}

static int read_limit(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    int end = 0;
    if (sscanf(text, "%" SCNu64 "%n", &faults->exchange_limit, &end) != 1 || text[end] != '\0' ||
        faults->exchange_limit == 0 || faults->exchange_limit > 1ull << 31)
        return kiln_fail(error, KILN_USAGE,
                         "KILN_EXCHANGE_LIMIT is '%.100s'; it is a number of elements, 1 to 2147483648: give one, or "
                         "unset it",
                         text);
    return KILN_OK;
}

static int read_dispatch(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    int end = 0;
    if (sscanf(text, "%lf%n", &faults->dispatch_time, &end) != 1 || text[end] != '\0' ||
        !(faults->dispatch_time >= 1.0 && faults->dispatch_time <= 60000.0))
        return kiln_fail(error, KILN_USAGE,
                         "KILN_DISPATCH_TIME is '%.100s'; it is a time in milliseconds, 1 to 60000: give one, or unset "
                         "it",
                         text);
    return KILN_OK;
}

static int read_locks(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    faults->no_locks = strcmp(text, "none") == 0;
    return faults->no_locks ? KILN_OK : kiln_fail(error, KILN_USAGE, "KILN_LOCKS is '%.100s'; it is none", text);
}

static int read_probes(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    faults->plain_probes = strcmp(text, "plain") == 0;
    return faults->plain_probes ? KILN_OK : kiln_fail(error, KILN_USAGE, "KILN_PROBES is '%.100s'; it is plain", text);
}

static int read_sight(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    faults->no_sight = strcmp(text, "none") == 0;
    return faults->no_sight ? KILN_OK : kiln_fail(error, KILN_USAGE, "KILN_SIGHT is '%.100s'; it is none", text);
}

static int read_device(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    char kind[16];
    unsigned long long at = 0, every = 0;
    int end = 0, longer = 0;
    if (sscanf(text, "%15[a-z]:%llu%n:%llu%n", kind, &at, &end, &every, &longer) < 2 ||
        text[longer > end ? longer : end] != '\0' || at == 0)
        return kiln_fail(
            error, KILN_USAGE,
            "KILN_GPU_FAULT is '%.100s'; it is lost:K or memory:K, with :N after it for every N calls more", text);
    if (strcmp(kind, "lost") != 0 && strcmp(kind, "memory") != 0)
        return kiln_fail(error, KILN_USAGE, "KILN_GPU_FAULT is '%.100s'; the faults are called lost and memory", text);
    faults->device.kind = strcmp(kind, "lost") == 0 ? KILN_DEVICE_FAULT_LOST : KILN_DEVICE_FAULT_MEMORY;
    faults->device.at = at;
    faults->device.every = every;
    return KILN_OK;
}

static int read_guard(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    static const char *const names[] = {
        [KILN_GUARD_NONE] = "0", [KILN_GUARD_AFTER] = "after", [KILN_GUARD_BEFORE] = "before"};
    for (unsigned guard = 0; guard < sizeof names / sizeof *names; guard++)
        if (strcmp(text, names[guard]) == 0) {
            faults->device.guard = guard;
            return KILN_OK;
        }
    return kiln_fail(error, KILN_USAGE, "KILN_VULKAN_GUARD is '%.100s'; it is after, before or 0", text);
}

static int read_makers(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    faults->device.makers = strcmp(text, "all") == 0;
    return faults->device.makers ? KILN_OK
                                 : kiln_fail(error, KILN_USAGE, "KILN_KERNEL_MAKERS is '%.100s'; it is all", text);
}

static int read_doubles(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    faults->device.floats = strcmp(text, "none") == 0;
    return faults->device.floats ? KILN_OK : kiln_fail(error, KILN_USAGE, "KILN_DOUBLES is '%.100s'; it is none", text);
}

static int read_traversal(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    static const char *const names[] = {[KILN_TRAVERSE_COMPUTE] = "compute",
                                        [KILN_TRAVERSE_PIPELINE] = "pipeline",
                                        [KILN_TRAVERSE_FOUR] = "four",
                                        [KILN_TRAVERSE_EIGHT] = "eight"};
    for (unsigned i = KILN_TRAVERSE_COMPUTE; i < sizeof names / sizeof *names; i++)
        if (strcmp(text, names[i]) == 0) {
            faults->traversal = i;
            return KILN_OK;
        }
    return kiln_fail(error, KILN_USAGE, "KILN_TRAVERSAL is '%.100s'; it is compute, pipeline, four or eight", text);
}

static int read_tree(struct kiln_faults *faults, const char *text, struct kiln_error *error)
{
    faults->device.tree = strcmp(text, "host") == 0     ? KILN_TREE_HOST
                          : strcmp(text, "device") == 0 ? KILN_TREE_DEVICE
                                                        : KILN_TREE_AS_USUAL;
    return faults->device.tree != KILN_TREE_AS_USUAL
               ? KILN_OK
               : kiln_fail(error, KILN_USAGE, "KILN_TREE is '%.100s'; it is host or device", text);
}

int kiln_faults_read(struct kiln_faults *faults, struct kiln_error *error)
{
    static const struct {
        const char *name;
        int (*read)(struct kiln_faults *faults, const char *text, struct kiln_error *error);
    } variables[] = {
        {"KILN_SLOW_RANK", read_slowness},    {"KILN_HALT_RANK", read_halt},      {"KILN_FAILING_PACKER", read_packer},
        {"KILN_LOCKS", read_locks},           {"KILN_GPU_FAULT", read_device},    {"KILN_VULKAN_GUARD", read_guard},
        {"KILN_PROBES", read_probes},         {"KILN_SIGHT", read_sight},         {"KILN_DIVIDE_FROM", read_division},
        {"KILN_KERNEL_MAKERS", read_makers},  {"KILN_TREE", read_tree},           {"KILN_HOLD", read_hold},
        {"KILN_DOUBLES", read_doubles},       {"KILN_TRAVERSAL", read_traversal}, {"KILN_EXCHANGE_LIMIT", read_limit},
        {"KILN_DISPATCH_TIME", read_dispatch}};
    int status = KILN_OK;
    *faults = (struct kiln_faults){0};
    for (size_t i = 0; status == KILN_OK && i < sizeof variables / sizeof *variables; i++) {
        const char *text = value_of(variables[i].name);
        if (text != NULL)
            status = variables[i].read(faults, text, error);
    }
    return status;
}

double kiln_faults_slowness(const struct kiln_faults *faults, uint32_t rank)
{
    return faults->slowness > 0.0 && faults->slow_rank == rank ? faults->slowness : 1.0;
}

const char *kiln_faults_halt(const struct kiln_faults *faults, uint32_t rank)
{
    return faults->halt_place[0] != '\0' && faults->halt_rank == rank ? faults->halt_place : NULL;
}

bool kiln_faults_packer_fails(const struct kiln_faults *faults, uint32_t rank)
{
    return faults != NULL && faults->packer_fails && faults->failing_packer == rank;
}
