/* Tests of guarded buffers: each case runs in its own process and must end with the expected status and message.
 * Skipped (77) if there is no software device. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/modules.h"
#include "worker/backend/vulkan/gpu/gpu.h"

enum { WORDS = 100, BYTES = 4 * WORDS };

/* Task of a child, on buffers of WORDS words. */
struct deed {
    enum kiln_buffer_guard guard;
    int read_from;      /* words after the source's first */
    uint32_t width;     /* words that the kernel reads and writes */
    bool short_target;  /* else it has room to spare */
    bool after_the_end; /* the source has been destroyed */
};

/* How it ends. */
struct outcome {
    int signal, status;
    char said[1024];
};

static int32_t software_device(void)
{
    struct kiln_device list[16];
    size_t count = 0;
    if (gpu_list(list, 16, &count, NULL) != KILN_OK)
        return -1;
    for (size_t i = 0; i < count && i < 16; i++)
        if (list[i].software && list[i].fit)
            return (int32_t)i;
    return -1;
}

static int add_words(struct gpu *gpu, const struct deed *deed, struct kiln_error *error)
{
    struct push {
        uint64_t scene, from, to;
        uint32_t width, height;
    };
    static const uint32_t words[WORDS] = {0}, constants[] = {0, 0, 0, 0, 0, 0, 1};
    const struct gpu_kernel_params params = {
        .name = "counter", .code = &kiln_code_counter, .constants = constants, .constant_count = 7};
    struct gpu_kernel *kernel = NULL;
    struct gpu_buffer source, target;
    int status = gpu_kernel_create(gpu, &kernel, &params, error);
    if (status == KILN_OK)
        status = gpu_buffer_of(gpu, &source, words, BYTES, "the source", error);
    if (status == KILN_OK)
        status =
            gpu_buffer_create(gpu, &target, deed->short_target ? BYTES : 2 * BYTES, GPU_DEVICE, "the target", error);
    if (status != KILN_OK)
        return status;
    const struct push push = {.from = source.address + (uint64_t)(4 * (int64_t)deed->read_from),
                              .to = target.address,
                              .width = deed->width,
                              .height = 1};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = deed->width, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    if (deed->after_the_end)
        gpu_buffer_destroy(gpu, &source);
    status = gpu_run(gpu, &step, 1, NULL, error);
    gpu_buffer_destroy(gpu, &source);
    gpu_buffer_destroy(gpu, &target);
    gpu_kernel_destroy(gpu, &kernel);
    return status;
}

static int act(const struct deed *deed, int32_t device)
{
    struct gpu *gpu = NULL;
    struct kiln_error error = {""};
    struct gpu_faults faults = {.wanted = {.guard = deed->guard}};
    int status = gpu_create(&gpu, &(struct gpu_choice){.device = device, .faults = &faults}, &error);
    if (status == KILN_OK)
        status = add_words(gpu, deed, &error);
    (void)fprintf(stderr, "%s\n", error.message);
    gpu_destroy(&gpu);
    return status;
}

static void read_all(int from, char *text, size_t room)
{
    size_t length = 0;
    for (ssize_t n = 1; n > 0 && length + 1 < room; length += n > 0 ? (size_t)n : 0)
        n = read(from, text + length, room - 1 - length);
    text[length] = '\0';
}

static struct outcome outcome_of(const struct deed *deed, int32_t device)
{
    struct outcome o = {0, 0, ""};
    int ends[2], how = 0;
    assert_int_equal(pipe(ends), 0);
    (void)fflush(NULL);
    const pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        (void)signal(SIGSEGV, SIG_DFL); /* cmocka has handlers for these */
        (void)signal(SIGABRT, SIG_DFL);
        (void)dup2(ends[1], STDERR_FILENO);
        (void)close(ends[0]);
        _exit(act(deed, device));
    }
    (void)close(ends[1]);
    read_all(ends[0], o.said, sizeof o.said);
    (void)close(ends[0]);
    assert_int_equal(waitpid(child, &how, 0), child);
    o.signal = WIFSIGNALED(how) ? WTERMSIG(how) : 0;
    o.status = WIFEXITED(how) ? WEXITSTATUS(how) : 0;
    return o;
}

static void expect(void **state, const struct deed *deed, int signal, const char *sentence)
{
    const struct outcome o = outcome_of(deed, *(const int32_t *)*state);
    if (strstr(o.said, sentence) == NULL)
        print_error("said: %s\n", o.said);
    assert_non_null(strstr(o.said, sentence));
#ifdef __SANITIZE_ADDRESS__ /* it takes over where the guard's handler ends, and exits */
    assert_true(signal == 0 ? o.status == KILN_OK : o.signal == signal || o.status != KILN_OK);
#else
    assert_int_equal(o.signal, signal);
    assert_int_equal(o.status, 0);
#endif
}

static void what_stays_within_bounds_is_left_alone(void **state)
{
    expect(state, &(struct deed){.guard = KILN_GUARD_NONE, .width = WORDS, .short_target = true}, 0, "");
    expect(state, &(struct deed){.guard = KILN_GUARD_AFTER, .width = WORDS, .short_target = true}, 0, "");
    expect(state, &(struct deed){.guard = KILN_GUARD_BEFORE, .width = WORDS, .short_target = true}, 0, "");
}

static void a_word_read_too_far_is_seen(void **state)
{
    expect(state, &(struct deed){.guard = KILN_GUARD_AFTER, .width = WORDS + 1}, SIGSEGV,
           "the kernel 'counter' reads byte 400 of 'the source', which has 400 bytes\n");
    expect(state, &(struct deed){.guard = KILN_GUARD_AFTER, .width = 1, .read_from = 5000}, SIGSEGV,
           "reads byte 20000 of 'the source'");
}

static void a_word_written_too_far_is_seen(void **state)
{
    expect(state, &(struct deed){.guard = KILN_GUARD_AFTER, .width = WORDS + 1, .read_from = -1, .short_target = true},
           SIGSEGV, "the kernel 'counter' writes byte 400 of 'the target', which has 400 bytes\n");
    expect(state, &(struct deed){.guard = KILN_GUARD_BEFORE, .width = WORDS + 1, .short_target = true}, SIGABRT,
           "something was written 400 bytes after the beginning of 'the target'");
}

static void a_word_read_too_early_is_seen(void **state)
{
    expect(state, &(struct deed){.guard = KILN_GUARD_BEFORE, .width = 1, .read_from = -1}, SIGSEGV,
           "the kernel 'counter' reads 4 bytes before 'the source', which has 400 bytes\n");
}

static void a_destroyed_buffer_is_not_to_be_read(void **state)
{
    expect(state, &(struct deed){.guard = KILN_GUARD_AFTER, .width = 1, .after_the_end = true}, SIGSEGV,
           "the kernel 'counter' reads byte 0 of 'the source', which has 400 bytes and has been destroyed\n");
}

/* Every size ends, or begins, where the guard does, and is filled with what nobody could mistake for an answer. */
static void new_buffers_hold_no_numbers(void **state)
{
    static const size_t sizes[] = {4, 60, 64, 68, 4092, 4096, 4100, 70000};
    for (size_t i = 0; i < 2; i++) {
        struct gpu *gpu = NULL;
        struct gpu_buffer buffer;
        struct gpu_faults faults = {.wanted = {.guard = i == 0 ? KILN_GUARD_AFTER : KILN_GUARD_BEFORE}};
        const struct gpu_choice choice = {.device = *(const int32_t *)*state, .faults = &faults};
        assert_int_equal(gpu_create(&gpu, &choice, NULL), KILN_OK);
        assert_true(gpu_guarded(gpu));
        for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
            uint32_t last = 0;
            assert_int_equal(gpu_buffer_create(gpu, &buffer, sizes[k], GPU_DEVICE, "words", NULL), KILN_OK);
            assert_int_equal((buffer.address + (i == 0 ? sizes[k] : 0)) % 4096, 0);
            assert_int_equal(gpu_buffer_tail(gpu, &buffer, 4), i == 0 ? sizes[k] - 4 : 0);
            assert_int_equal(gpu_download(gpu, &buffer, sizes[k] - 4, &last, 4, NULL), KILN_OK);
            assert_int_equal(last, 0xffffffff);
            gpu_buffer_destroy(gpu, &buffer);
        }
        gpu_destroy(&gpu);
    }
}

int main(void)
{
    int32_t device = software_device();
    const struct CMUnitTest tests[] = {
        /* first those that start processes, while there are no threads here */
        cmocka_unit_test_prestate(what_stays_within_bounds_is_left_alone, &device),
        cmocka_unit_test_prestate(a_word_read_too_far_is_seen, &device),
        cmocka_unit_test_prestate(a_word_written_too_far_is_seen, &device),
        cmocka_unit_test_prestate(a_word_read_too_early_is_seen, &device),
        cmocka_unit_test_prestate(a_destroyed_buffer_is_not_to_be_read, &device),
        cmocka_unit_test_prestate(new_buffers_hold_no_numbers, &device),
    };
    if (device < 0) {
        (void)printf("skipped: there is no software Vulkan device here\n");
        return 77;
    }
    return cmocka_run_group_tests(tests, NULL, NULL);
}
