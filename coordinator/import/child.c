#include "coordinator/import/assemble.h"
#include "coordinator/import/child.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "coordinator/confined/confined.h"
#include "coordinator/confined/fence.h"
#include "coordinator/import/read.h"
#include "coordinator/layout/layout.h"
#include "worker/base/memory.h"

struct child {
    struct kiln_import_params params;
    uint64_t program;
};

/* ---- resource limits, soft, raised with the size of the scene's files as they are opened ---- */

static uint64_t machine_memory(void)
{
    const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    return pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size : (uint64_t)1 << 34;
}

static void limit_memory(uint64_t bytes)
{
    /* AddressSanitizer reserves terabytes of address space: no limit on it can be set there. */
    if (!KILN_ADDRESS_SANITIZER)
        kiln_fence_limit(RLIMIT_AS, bytes);
}

static uint64_t default_memory(uint64_t file_bytes)
{
    const uint64_t wanted = ((uint64_t)4 << 30) + 64 * file_bytes, most = machine_memory() / 4 * 3;
    return wanted < most ? wanted : most;
}

static uint64_t default_seconds(uint64_t file_bytes) { return 60 + file_bytes / 10000000; }

static void follow_memory(const struct kiln_confine *confine) { limit_memory(default_memory(confine->total_bytes)); }
static void follow_time(const struct kiln_confine *confine)
{
    kiln_fence_limit(RLIMIT_CPU, default_seconds(confine->total_bytes));
}
static void follow_both(const struct kiln_confine *confine)
{
    follow_memory(confine);
    follow_time(confine);
}
static void follow_nothing(const struct kiln_confine *confine) { (void)confine; }

static void set_limits(const struct kiln_import_params *params)
{
    kiln_fence_limit(RLIMIT_NOFILE, 64);
    kiln_fence_limit(RLIMIT_FSIZE, (uint64_t)1 << 40);
    limit_memory(params->memory_limit != 0 ? params->memory_limit : default_memory(0));
    kiln_fence_limit(RLIMIT_CPU, params->time_limit != 0 ? params->time_limit : default_seconds(0));
}

void (*kiln_child_follower(const struct kiln_import_params *params))(const struct kiln_confine *)
{
    if (params->memory_limit == 0)
        return params->time_limit == 0 ? follow_both : follow_memory;
    return params->time_limit == 0 ? follow_time : follow_nothing;
}

/* Extends the CPU time limit for the layout, whose work depends on triangles and not on bytes. */
static void limit_layout_time(const struct kiln_import_params *params, const struct kiln_builder *builder)
{
    struct rusage used;
    if (params->time_limit != 0 || getrusage(RUSAGE_SELF, &used) != 0)
        return;
    kiln_fence_limit(RLIMIT_CPU, (uint64_t)used.ru_utime.tv_sec + (uint64_t)used.ru_stime.tv_sec + 60 +
                                     builder->sections[KILN_SECTION_TRIANGLES].count / 2000);
}

/* ---- Landlock: a second barrier against file access, on kernels that have it ---- */

static int allow(int rules, const char *path, uint64_t access)
{
    struct landlock_path_beneath_attr rule = {.allowed_access = access, .parent_fd = open(path, O_PATH | O_CLOEXEC)};
    if (rule.parent_fd < 0)
        return -1;
    const long result = syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0);
    (void)close(rule.parent_fd);
    return (int)result;
}

static void cut_to_folder(char *path)
{
    char *slash = path == NULL ? NULL : strrchr(path, '/');
    if (slash != NULL)
        slash[slash == path ? 1 : 0] = '\0';
    else if (path != NULL && path[0] != '\0')
        (void)snprintf(path, 2, "."); /* a bare file name stands for one in the current folder */
}

static void fence_files(const struct kiln_import_params *params)
{
    const uint64_t read = LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR;
    const uint64_t write = LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_REMOVE_FILE;
    const uint64_t other = LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_REMOVE_DIR | LANDLOCK_ACCESS_FS_MAKE_CHAR |
                           LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO |
                           LANDLOCK_ACCESS_FS_MAKE_BLOCK | LANDLOCK_ACCESS_FS_MAKE_SYM;
    const struct landlock_ruleset_attr attributes = {.handled_access_fs = read | write | other};
    /* AddressSanitizer needs /proc and its symbolizer for its reports */
    if (KILN_ADDRESS_SANITIZER)
        return;
    const int rules = (int)syscall(SYS_landlock_create_ruleset, &attributes, sizeof attributes, 0);
    if (rules < 0)
        return; /* an older kernel: openat2 is the only barrier */
    char *folder = realpath(params->path, NULL);
    cut_to_folder(folder);
    const bool image = params->environment != NULL && access(params->environment, F_OK) == 0;
    if (folder != NULL && allow(rules, folder, read) == 0 &&
        (!image || allow(rules, params->environment, LANDLOCK_ACCESS_FS_READ_FILE) == 0) &&
        prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0)
        (void)syscall(SYS_landlock_restrict_self, rules, 0);
    free(folder);
    (void)close(rules);
}

void kiln_child_confine(const struct kiln_import_params *params)
{
    kiln_fence_begin();
    set_limits(params);
    fence_files(params);
}

/* ---- the work ---- */

/* Least bytes of a texel that is a surface point. A lightmap with more texels than memory has room for at this size
 * cannot be baked on this host or one like it. */
enum { LEAST_OF_TEXEL = 8 };

static int make_layouts(const struct kiln_import_params *params, struct kiln_builder *builder, struct kiln_error *error)
{
    const struct kiln_layout_params layout = {.scene = params->path,
                                              .texels_max = (double)(machine_memory() / LEAST_OF_TEXEL),
                                              .texels_per_metre = params->texels_per_metre,
                                              .texels = params->texels,
                                              .lightmap_size = params->lightmap_size,
                                              .lightmap_max = params->lightmap_max,
                                              .repack = params->repack,
                                              .keep_shared = params->keep_shared};
    int status;
    limit_layout_time(params, builder);
    KILN_TRY(params->no_layout ? kiln_layout_none(builder, params->texels_per_metre, error)
                               : kiln_layout(builder, &layout, error));
    KILN_TRY(kiln_note_coarse_coordinates(builder, error));
end:
    return status;
}

static int judge_part(const struct kiln_import_params *params, struct kiln_builder *builder, struct kiln_error *error)
{
    int status;
    limit_layout_time(params, builder);
    KILN_TRY(kiln_layout_judge(builder, error));
    KILN_TRY(kiln_builder_make_part(builder, error));
end:
    return status;
}

static int read_layout_write(const struct child *child, struct kiln_error *error)
{
    const struct kiln_import_params *params = &child->params;
    struct kiln_builder *builder = NULL;
    int status;
    KILN_TRY(kiln_builder_create(&builder, error));
    KILN_TRY(kiln_import_read(params, kiln_child_follower(params), builder, error));
    KILN_TRY(params->part ? judge_part(params, builder, error) : make_layouts(params, builder, error));
    kiln_import_key(params, child->program, KILN_BUILDER_DATA(builder, const struct kiln_source, KILN_SECTION_SOURCES),
                    builder->sections[KILN_SECTION_SOURCES].count,
                    KILN_BUILDER_DATA(builder, const char, KILN_SECTION_STRINGS), builder->import_hash);
    KILN_TRY(kiln_builder_write_to(builder, KILN_CHILD_OUTPUT, params->output, error));
end:
    kiln_builder_destroy(&builder);
    if (status == KILN_SYSTEM && strncmp(error->message, "out of memory", 13) == 0) {
        struct rlimit most = {0};
        (void)getrlimit(RLIMIT_AS, &most);
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "%.512s: reading it takes more than the %llu MiB of memory allowed for files of its size; "
                           "simplify the scene",
                           params->path, (unsigned long long)most.rlim_cur >> 20);
    }
    return status;
}

static bool parse_arguments(int argc, char **argv, struct child *child)
{
    if (argc != KILN_CHILD_ARGUMENTS)
        return false;
    child->params = (struct kiln_import_params){.path = argv[2],
                                                .output = argv[3],
                                                .texels_per_metre = strtod(argv[4], NULL),
                                                .lightmap_size = (uint32_t)strtoul(argv[5], NULL, 10),
                                                .lightmap_max = (uint32_t)strtoul(argv[6], NULL, 10),
                                                .environment = argv[7][0] == '\0' ? NULL : argv[7],
                                                .environment_scale = strtod(argv[8], NULL),
                                                .environment_rotation_degrees = strtod(argv[9], NULL),
                                                .memory_limit = strtoull(argv[10], NULL, 10),
                                                .time_limit = (uint32_t)strtoul(argv[11], NULL, 10),
                                                .objects = argv[13],
                                                .trust_normals = strcmp(argv[14], "normals") == 0,
                                                .repack = strcmp(argv[15], "repack") == 0,
                                                .keep_shared = strcmp(argv[15], "keep") == 0,
                                                .no_layout = strcmp(argv[15], "none") == 0,
                                                .part = strcmp(argv[15], "part") == 0,
                                                .changes = argv[16][0] == '\0' ? NULL : argv[16],
                                                .up_z = strcmp(argv[17], "z") == 0,
                                                .unit = strtod(argv[18], NULL),
                                                .strict = argv[19][0] != '\0',
                                                .texels = strtod(argv[20], NULL)};
    child->program = strtoull(argv[12], NULL, 16);
    return true;
}

void kiln_child_answer(int status, const char *sentence)
{
    char text[sizeof(struct kiln_error) + 16];
    const int length = snprintf(text, sizeof text, "%d\n%s", status, sentence);
    for (ssize_t at = 0; at < length;) {
        const ssize_t written = write(STDOUT_FILENO, text + at, (size_t)(length - at));
        if (written < 0 && errno != EINTR)
            return; /* the parent has closed the pipe */
        at += written > 0 ? written : 0;
    }
}

int kiln_import_child(int argc, char **argv)
{
    struct child child;
    struct kiln_error error = {""};
    if (!parse_arguments(argc, argv, &child)) {
        (void)fprintf(stderr, "import-child is not a command for users: kiln starts it itself\n");
        return KILN_USAGE;
    }
    kiln_child_confine(&child.params);
    const int status = read_layout_write(&child, &error);
    kiln_child_answer(status, error.message);
    return status;
}
