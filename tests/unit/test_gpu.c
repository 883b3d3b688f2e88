/* Tests of the Vulkan device layer, on any device, also a software one. Skipped (77) if there is none. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/modules.h"
#include "worker/backend/vulkan/gpu/gpu.h"

struct push {
    uint64_t scene, from, to;
    uint32_t width, height;
};

static struct gpu *create(const struct gpu_choice *choice)
{
    struct kiln_error error = {0};
    struct gpu *gpu = NULL;
    const int status = gpu_create(&gpu, choice, &error);
    if (status != KILN_OK)
        print_error("%s\n", error.message);
    assert_int_equal(status, KILN_OK);
    return gpu;
}

static struct gpu_kernel *counter(struct gpu *gpu, uint32_t step)
{
    const uint32_t constants[] = {0, 0, 0, 0, 0, 0, step};
    const struct gpu_kernel_params params = {
        .name = "counter", .code = &kiln_code_counter, .constants = constants, .constant_count = 7};
    struct gpu_kernel *kernel = NULL;
    assert_int_equal(gpu_kernel_create(gpu, &kernel, &params, NULL), KILN_OK);
    return kernel;
}

static void devices_are_listed_in_order(void **state)
{
    (void)state;
    struct kiln_device list[16];
    size_t count = 0;
    assert_int_equal(gpu_list(list, 16, &count, NULL), KILN_OK);
    assert_true(count >= 1);
    for (size_t i = 0; i < count && i < 16; i++) {
        assert_int_equal(list[i].index, i);
        assert_true(list[i].fit == (list[i].lacks[0] == '\0'));
        assert_true(!list[i].fit || (list[i].memory > 0 && list[i].subgroup > 0 && list[i].name[0] != '\0'));
        assert_true(i == 0 || list[i].software >= list[i - 1].software);
    }
}

static void what_goes_up_comes_down(void **state)
{
    (void)state;
    enum { WORDS = (20 << 20) / 4 + 17 }; /* more than two pieces of staging, and some */
    struct gpu *gpu = create(&(struct gpu_choice){.device = -1});
    struct gpu_buffer buffer;
    uint32_t *out = malloc(WORDS * sizeof *out), *in = calloc(WORDS, sizeof *in);
    const uint64_t before = gpu_memory_used(gpu);
    for (uint32_t i = 0; i < WORDS; i++)
        out[i] = i * 2654435761u;
    assert_int_equal(gpu_buffer_of(gpu, &buffer, out, WORDS * sizeof *out, "a test's words", NULL), KILN_OK);
    assert_true((buffer.address % 64 == 0 || gpu_guarded(gpu)) && buffer.mapped == NULL &&
                gpu_memory_used(gpu) >= before + buffer.size);
    assert_int_equal(gpu_download(gpu, &buffer, 0, in, WORDS * sizeof *in, NULL), KILN_OK);
    assert_memory_equal(out, in, WORDS * sizeof *in);
    assert_int_equal(gpu_upload(gpu, &buffer, 400, in, 12, NULL), KILN_OK); /* a few words in the middle */
    assert_int_equal(gpu_download(gpu, &buffer, 396, in, 20, NULL), KILN_OK);
    assert_int_equal(in[0], out[99]);
    assert_memory_equal(in + 1, out, 12);
    assert_int_equal(in[4], out[103]);
    gpu_buffer_destroy(gpu, &buffer);
    assert_int_equal(gpu_memory_used(gpu), before);
    assert_int_equal(gpu_buffer_create(gpu, &buffer, 0, GPU_DEVICE, "nothing", NULL), KILN_OK);
    assert_int_equal(buffer.address, 0);
    gpu_buffer_destroy(gpu, &buffer);
    free(out);
    free(in);
    gpu_destroy(&gpu);
    assert_null(gpu);
}

/* Runs the counter over width x height words that are all 7. */
static void count_words(struct gpu *gpu, uint32_t width, uint32_t height, uint32_t step)
{
    const size_t words = (size_t)width * height;
    struct gpu_buffer from, to;
    struct gpu_kernel *kernel = counter(gpu, step);
    uint32_t *values = malloc(words * sizeof *values);
    double seconds = -1.0;
    size_t wrong = 0;
    for (size_t i = 0; i < words; i++)
        values[i] = 7;
    assert_int_equal(gpu_buffer_of(gpu, &from, values, words * sizeof *values, "words", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_create(gpu, &to, words * sizeof *values, GPU_DEVICE, "words", NULL), KILN_OK);
    const struct push push = {.from = from.address, .to = to.address, .width = width, .height = height};
    const struct gpu_step one = {
        .kernel = kernel, .threads_x = width, .threads_y = height, .constants = &push, .constant_bytes = sizeof push};
    assert_int_equal(gpu_run(gpu, &one, 1, &seconds, NULL), KILN_OK);
    assert_true(seconds > 0.0);
    assert_int_equal(gpu_download(gpu, &to, 0, values, words * sizeof *values, NULL), KILN_OK);
    for (size_t i = 0; i < words; i++)
        wrong += values[i] != 7 + (uint32_t)(i % width) + 3 * (uint32_t)(i / width) + step;
    assert_int_equal(wrong, 0);
    gpu_buffer_destroy(gpu, &from);
    gpu_buffer_destroy(gpu, &to);
    gpu_kernel_destroy(gpu, &kernel);
    free(values);
}

static void kernels_reach_every_thread(void **state)
{
    (void)state;
    struct gpu *gpu = create(&(struct gpu_choice){.device = -1});
    count_words(gpu, 1, 1, 5);
    count_words(gpu, 1000, 33, 0);
    count_words(gpu, 5000001, 1, 9); /* x has more than 65,535 workgroups */
    count_words(gpu, 70, 70003, 1);  /* more than 65,535 rows */
    count_words(gpu, 3, 32768, 2);   /* the number of rows that says: rows go on in z */
    gpu_destroy(&gpu);
}

/* Each step sees what the steps before it wrote, and so does each submission. */
static void steps_follow_each_other(void **state)
{
    (void)state;
    enum { N = 100000 };
    struct gpu *gpu = create(&(struct gpu_choice){.device = -1});
    struct gpu_buffer a, b, back;
    struct gpu_kernel *kernel = counter(gpu, 1);
    double seconds[GPU_SLOTS], sum = 0.0;
    assert_int_equal(gpu_buffer_create(gpu, &a, N * 4, GPU_DEVICE, "a", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_create(gpu, &b, N * 4, GPU_DEVICE, "b", NULL), KILN_OK);
    assert_int_equal(gpu_buffer_create(gpu, &back, N * 4, GPU_HOST, "answers", NULL), KILN_OK);
    memset(back.mapped, 0, N * 4);
    const struct push there = {.from = a.address, .to = b.address, .width = N, .height = 1};
    const struct push here = {.from = b.address, .to = a.address, .width = N, .height = 1};
    const struct gpu_step first = {.from = &back, .to = &a, .size = N * 4};
    const struct gpu_step steps[] = {
        {.kernel = kernel, .threads_x = N, .threads_y = 1, .constants = &there, .constant_bytes = sizeof there},
        {.kernel = kernel, .threads_x = 0, .threads_y = 1}, /* nothing */
        {.kernel = kernel, .threads_x = N, .threads_y = 1, .constants = &here, .constant_bytes = sizeof here},
        {.from = &a, .to = &back, .size = N * 4},
    };
    assert_int_equal(gpu_run(gpu, &first, 1, NULL, NULL), KILN_OK);
    for (uint32_t slot = 0; slot < GPU_SLOTS; slot++)
        assert_int_equal(gpu_submit(gpu, slot, steps, 4, NULL), KILN_OK);
    for (uint32_t slot = 0; slot < GPU_SLOTS; slot++) {
        assert_int_equal(gpu_wait(gpu, slot, &seconds[slot], NULL), KILN_OK);
        assert_true(seconds[slot] > 0.0);
        sum += seconds[slot];
    }
    const uint32_t *answers = back.mapped;
    for (uint32_t i = 0; i < N; i++)
        assert_int_equal(answers[i], 2 * GPU_SLOTS * (i + 1));
    struct gpu_clock clock;
    gpu_clock_read(gpu, &clock);
    assert_true(clock.busy >= sum && clock.busy <= clock.elapsed);
    gpu_buffer_destroy(gpu, &a);
    gpu_buffer_destroy(gpu, &b);
    gpu_buffer_destroy(gpu, &back);
    gpu_kernel_destroy(gpu, &kernel);
    gpu_destroy(&gpu);
}

/* Returns the number of words in `answers` that are not what submission `k` has counted. */
static size_t wrong_answers(const uint32_t *answers, uint32_t count, uint32_t k)
{
    size_t wrong = 0;
    for (uint32_t i = 0; i < count; i++)
        wrong += answers[i] != i + 1 + k;
    return wrong;
}

/* A copy aside has what its own submission's kernels wrote, whatever is submitted behind it, again and again in one
 * slot; what is filled meanwhile is whole. */
static void copies_go_aside(void **state)
{
    (void)state;
    enum { N = 50000, ROUNDS = 3, SUBMISSIONS = GPU_SLOTS * ROUNDS };
    struct gpu *gpu = create(&(struct gpu_choice){.device = -1, .threads = 2, .validation = true});
    struct gpu_buffer zeros, to[GPU_SLOTS], back[GPU_SLOTS], filled[SUBMISSIONS];
    struct gpu_kernel *kernels[SUBMISSIONS];
    uint32_t *words = calloc(N, sizeof *words);
    size_t wrong = 0;
    assert_int_equal(gpu_buffer_of(gpu, &zeros, words, N * 4, "zeros", NULL), KILN_OK);
    for (uint32_t i = 0; i < GPU_SLOTS; i++) {
        assert_int_equal(gpu_buffer_create(gpu, &to[i], N * 4, GPU_DEVICE, "sums", NULL), KILN_OK);
        assert_int_equal(gpu_buffer_create(gpu, &back[i], N * 4, GPU_HOST, "answers", NULL), KILN_OK);
    }
    for (uint32_t k = 0; k < SUBMISSIONS + GPU_SLOTS; k++) {
        const uint32_t slot = k % GPU_SLOTS;
        assert_int_equal(gpu_wait(gpu, slot, NULL, NULL), KILN_OK);
        wrong += k >= GPU_SLOTS ? wrong_answers(back[slot].mapped, N - 1, k - GPU_SLOTS) : 0;
        if (k >= SUBMISSIONS)
            continue;
        kernels[k] = counter(gpu, k);
        const struct push push = {.from = zeros.address, .to = to[slot].address, .width = N, .height = 1};
        const struct gpu_step steps[] = {
            {.kernel = kernels[k], .threads_x = N, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push},
            {.aside = true, .from = &to[slot], .to = &back[slot], .from_offset = 4, .size = (N - 1) * 4},
        };
        assert_int_equal(gpu_submit(gpu, slot, steps, 2, NULL), KILN_OK);
        for (uint32_t i = 0; i < N; i++)
            words[i] = i + 1 + k;
        assert_int_equal(gpu_buffer_of(gpu, &filled[k], words, N * 4, "filled", NULL), KILN_OK);
    }
    for (uint32_t k = 0; k < SUBMISSIONS; k++) {
        assert_int_equal(gpu_download(gpu, &filled[k], 0, words, N * 4, NULL), KILN_OK);
        wrong += wrong_answers(words, N, k);
        gpu_buffer_destroy(gpu, &filled[k]);
        gpu_kernel_destroy(gpu, &kernels[k]);
    }
    assert_int_equal(wrong, 0);
    assert_int_equal(gpu_messages(gpu), 0);
    for (uint32_t i = 0; i < GPU_SLOTS; i++) {
        gpu_buffer_destroy(gpu, &to[i]);
        gpu_buffer_destroy(gpu, &back[i]);
    }
    gpu_buffer_destroy(gpu, &zeros);
    free(words);
    gpu_destroy(&gpu);
}

static void memory_has_its_limit(void **state)
{
    (void)state;
    const size_t limit = 100u << 20;
    struct gpu *gpu = create(&(struct gpu_choice){.device = -1, .memory_limit = limit});
    struct gpu_buffer a, b;
    struct kiln_error error = {0};
    assert_true(gpu_memory_left(gpu) + gpu_memory_used(gpu) == limit);
    assert_int_equal(gpu_buffer_create(gpu, &a, 60u << 20, GPU_DEVICE, "the first", &error), KILN_OK);
    assert_false(gpu_short_of_memory(gpu));
    assert_int_equal(gpu_buffer_create(gpu, &b, 60u << 20, GPU_DEVICE, "the second", &error), KILN_NO_DEVICE);
    assert_non_null(strstr(error.message, "the second"));
    assert_non_null(strstr(error.message, "60.0 MiB"));
    assert_non_null(strstr(error.message, "100.0 MiB"));
    assert_true(gpu_short_of_memory(gpu) && !gpu_lost(gpu));
    gpu_buffer_destroy(gpu, &a);
    assert_int_equal(gpu_buffer_create(gpu, &b, 60u << 20, GPU_DEVICE, "the second", &error), KILN_OK);
    assert_false(gpu_short_of_memory(gpu));
    gpu_buffer_destroy(gpu, &b);
    assert_int_equal(gpu_buffer_create(gpu, &b, (size_t)1 << 50, GPU_DEVICE, "the absurd", &error), KILN_NO_DEVICE);
    gpu_destroy(&gpu);
}

static void choices_that_cannot_be_met_are_refused(void **state)
{
    (void)state;
    struct kiln_error error = {0};
    struct gpu *gpu = NULL;
    assert_int_equal(gpu_create(&gpu, &(struct gpu_choice){.device = 12345}, &error), KILN_NO_DEVICE);
    assert_null(gpu);
    assert_non_null(strstr(error.message, "12345"));
    assert_non_null(strstr(error.message, "found: 0 "));
}

/* Does everything that the other tests do, on small buffers; stops at the first failure and frees everything. */
static int work(struct gpu_faults *faults, bool *lost, bool *short_of_memory)
{
    enum { N = 5000 };
    struct gpu *gpu = NULL;
    struct gpu_buffer a = {0}, b = {0}, back = {0};
    struct gpu_kernel *kernel = NULL;
    uint32_t words[N] = {0};
    const uint32_t constants[] = {0, 0, 0, 0, 0, 0, 1};
    const struct gpu_kernel_params params = {
        .name = "counter", .code = &kiln_code_counter, .constants = constants, .constant_count = 7};
    *lost = *short_of_memory = false;
    struct kiln_error error = {0};
    int status = gpu_create(&gpu, &(struct gpu_choice){.device = -1, .faults = faults}, &error);
    if (status != KILN_OK)
        goto end;
    status = gpu_buffer_of(gpu, &a, words, sizeof words, "a", &error);
    if (status == KILN_OK)
        status = gpu_buffer_create(gpu, &b, sizeof words, GPU_DEVICE, "b", &error);
    if (status == KILN_OK)
        status = gpu_buffer_create(gpu, &back, sizeof words, GPU_HOST, "answers", &error);
    if (status == KILN_OK)
        status = gpu_kernel_create(gpu, &kernel, &params, &error);
    const struct push push = {.from = a.address, .to = b.address, .width = N, .height = 1};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = N, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    const struct gpu_step steps[] = {step, {.aside = true, .from = &b, .to = &back, .size = sizeof words}};
    if (status == KILN_OK)
        status = gpu_submit(gpu, 1, steps, 2, &error);
    if (status == KILN_OK)
        status = gpu_run(gpu, &step, 1, NULL, &error);
    if (status == KILN_OK)
        status = gpu_wait(gpu, 1, NULL, &error);
    if (status == KILN_OK)
        status = gpu_download(gpu, &b, 0, words, sizeof words, &error);
    if (status == KILN_OK && (words[N - 1] != N || ((const uint32_t *)back.mapped)[N - 1] != N))
        status = KILN_BUG;
    *lost = gpu_lost(gpu);
    *short_of_memory = gpu_short_of_memory(gpu);
    gpu_kernel_destroy(gpu, &kernel);
    gpu_buffer_destroy(gpu, &a);
    gpu_buffer_destroy(gpu, &b);
    gpu_buffer_destroy(gpu, &back);
end:
    assert_true((status == KILN_OK) == (error.message[0] == '\0'));
    gpu_destroy(&gpu);
    return status;
}

/* Whichever Vulkan call fails, in either way, the failure is reported and all resources are freed. */
static void every_call_may_fail(void **state)
{
    (void)state;
    struct gpu_faults none = {{0}, 0}, count = {.wanted = {.kind = KILN_DEVICE_FAULT_LOST, .at = UINT64_MAX}};
    bool lost, short_of_memory, was_lost = false, was_short = false;
    struct gpu_faults start = count, always = {.wanted = {.kind = KILN_DEVICE_FAULT_LOST, .at = 1, .every = 1}};
    struct gpu *gpu = create(&(struct gpu_choice){.device = -1, .faults = &start});
    const uint64_t starting = start.calls;
    gpu_destroy(&gpu);
    assert_int_equal(work(&always, &lost, &short_of_memory), KILN_NO_DEVICE);
    assert_int_equal(work(&none, &lost, &short_of_memory), KILN_OK);
    assert_int_equal(work(&count, &lost, &short_of_memory), KILN_OK);
    assert_true(count.calls > 50);
#ifdef __SANITIZE_ADDRESS__
    const uint64_t stride = 11; /* a driver under a sanitizer is slow to start */
#else
    const uint64_t stride = 1;
#endif
    for (uint64_t at = 1; at <= count.calls; at += stride)
        for (unsigned kind = KILN_DEVICE_FAULT_LOST; kind <= KILN_DEVICE_FAULT_MEMORY; kind++) {
            struct gpu_faults faults = {.wanted = {.kind = kind, .at = at}};
            const int status = work(&faults, &lost, &short_of_memory);
            assert_int_equal(status, at <= starting ? KILN_OK : KILN_NO_DEVICE); /* a start is tried again */
            assert_true(kind == KILN_DEVICE_FAULT_LOST ? !short_of_memory : !lost);
            was_lost |= lost;
            was_short |= short_of_memory;
            assert_int_equal(work(&faults, &lost, &short_of_memory), KILN_OK); /* once only */
        }
    assert_true(was_lost && was_short);
}

/* The validation layer finds nothing to say; skipped by itself where it is not installed. */
static void validation_is_silent(void **state)
{
    (void)state;
    struct gpu *gpu = NULL;
    struct kiln_error error = {0};
    if (gpu_create(&gpu, &(struct gpu_choice){.device = -1, .validation = true}, &error) != KILN_OK) {
        print_message("%s\n", error.message);
        skip();
    }
    count_words(gpu, 1000, 33, 0);
    assert_int_equal(gpu_messages(gpu), 0);
    gpu_destroy(&gpu);
}

static void pace_follows_what_is_measured(void **state)
{
    (void)state;
    struct gpu_pacer pacer = {.slice_seconds = 0.1};
    assert_int_equal(gpu_pacer_next(&pacer, 1000), 1000);
    gpu_pacer_learn(&pacer, 1000, 0.01);
    assert_int_equal(gpu_pacer_next(&pacer, 1000), 8000);
    gpu_pacer_learn(&pacer, 8000, 0.16);
    assert_int_equal(gpu_pacer_next(&pacer, 1000), 4000);
    gpu_pacer_learn(&pacer, 0, 0.0);
    assert_int_equal(gpu_pacer_next(&pacer, 1000), 4000);
}

/* Time of `threads`, s: 1 us each in the mean, and 100 ms for one of them. Together they take longer than the slice. */
static double took(uint64_t threads) { return 0.1 + 1e-6 * (double)threads; }

static void pace_does_not_wait_for_few(void **state)
{
    (void)state;
    struct gpu_pacer pacer = {.slice_seconds = 0.1}, filling = pacer;
    assert_int_equal(gpu_pacer_next_filling(&filling, 100000, 64), 100000);
    for (uint32_t i = 0; i < 100; i++) {
        const uint64_t some = gpu_pacer_next(&pacer, 100000), more = gpu_pacer_next_filling(&filling, 100000, 64);
        gpu_pacer_learn(&pacer, some, took(some));
        gpu_pacer_learn(&filling, more, took(more));
    }
    assert_int_equal(gpu_pacer_next(&pacer, 1), 1); /* ever fewer, and none of them sooner */
    assert_in_range(gpu_pacer_next_filling(&filling, 1, 64), 20000, 80000);
    assert_int_equal(gpu_pacer_next_filling(&filling, 1, 90000), 90000);
    gpu_pacer_learn(&filling, 40000, 1.0); /* far too long: never more than four times what the slice is enough for */
    assert_int_equal(gpu_pacer_next_filling(&filling, 1, 64), 4 * gpu_pacer_next(&filling, 1));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(devices_are_listed_in_order),
        cmocka_unit_test(what_goes_up_comes_down),
        cmocka_unit_test(kernels_reach_every_thread),
        cmocka_unit_test(steps_follow_each_other),
        cmocka_unit_test(copies_go_aside),
        cmocka_unit_test(memory_has_its_limit),
        cmocka_unit_test(choices_that_cannot_be_met_are_refused),
        cmocka_unit_test(every_call_may_fail),
        cmocka_unit_test(validation_is_silent),
        cmocka_unit_test(pace_follows_what_is_measured),
        cmocka_unit_test(pace_does_not_wait_for_few),
    };
    struct kiln_error error = {0};
    struct gpu *gpu = NULL;
    if (gpu_create(&gpu, &(struct gpu_choice){.device = -1}, &error) != KILN_OK) {
        (void)printf("skipped: %s\n", error.message);
        return 77;
    }
    gpu_destroy(&gpu);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
