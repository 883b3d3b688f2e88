/* Time that each kernel takes to run and to compile, for optimization: with KILN_VULKAN_TIMES=1 a table is printed to
 * stderr when the device is closed. The device's clock is then read after each step. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

enum { MOST_KERNELS = 128, NAME = 48 };

struct kernel_times {
    char name[NAME];
    uint32_t constant;
    uint64_t dispatches, threads;
    double seconds, making; /* s: running on the device; compiling in the driver */
};

struct gpu_times {
    struct kernel_times kernels[MOST_KERNELS];
    size_t count;
    uint64_t submissions;
    double waited;         /* s, of the host for submissions */
    pthread_mutex_t mutex; /* several threads compile kernels */
};

void gpu_times_create(struct gpu *gpu)
{
    const char *wish = getenv("KILN_VULKAN_TIMES");
    struct kiln_error error;
    if (wish == NULL || strcmp(wish, "1") != 0 ||
        kiln_allocate(&gpu->times, 1, sizeof *gpu->times, "times of kernels", &error) != KILN_OK)
        return; /* does without */
    (void)pthread_mutex_init(&gpu->times->mutex, NULL);
}

static struct kernel_times *times_of(struct gpu_times *t, const char *name, uint32_t constant)
{
    size_t i = 0;
    while (i < t->count && (strncmp(t->kernels[i].name, name, NAME - 1) != 0 || t->kernels[i].constant != constant))
        i++;
    if (i == MOST_KERNELS)
        return &t->kernels[MOST_KERNELS - 1];
    if (i == t->count) {
        (void)snprintf(t->kernels[i].name, NAME, "%s", name);
        t->kernels[i].constant = constant;
        t->count++;
    }
    return &t->kernels[i];
}

void gpu_times_add(struct gpu *gpu, const char *name, uint32_t constant, uint64_t threads, double seconds)
{
    (void)pthread_mutex_lock(&gpu->times->mutex);
    struct kernel_times *k = times_of(gpu->times, name, constant);
    k->dispatches++;
    k->threads += threads;
    k->seconds += seconds;
    (void)pthread_mutex_unlock(&gpu->times->mutex);
}

void gpu_times_make(struct gpu *gpu, const char *name, uint32_t constant, double seconds)
{
    (void)pthread_mutex_lock(&gpu->times->mutex);
    times_of(gpu->times, name, constant)->making += seconds;
    (void)pthread_mutex_unlock(&gpu->times->mutex);
}

void gpu_times_wait(struct gpu *gpu, double seconds)
{
    gpu->times->submissions++;
    gpu->times->waited += seconds;
}

static int longer(const void *a, const void *b)
{
    const double x = ((const struct kernel_times *)a)->seconds, y = ((const struct kernel_times *)b)->seconds;
    return (x < y) - (x > y);
}

void gpu_times_destroy(struct gpu *gpu)
{
    struct gpu_times *t = gpu->times;
    if (t == NULL)
        return;
    qsort(t->kernels, t->count, sizeof *t->kernels, longer);
    (void)fprintf(stderr, "%-*s %8s %10s %12s %9s %9s %9s\n", NAME, "kernel", "constant", "dispatches", "threads", "ms",
                  "M/s", "made in s");
    for (size_t i = 0; i < t->count; i++) {
        const struct kernel_times *k = &t->kernels[i];
        (void)fprintf(stderr, "%-*s %8x %10llu %12llu %9.2f %9.0f %9.2f\n", NAME, k->name, (unsigned)k->constant,
                      (unsigned long long)k->dispatches, (unsigned long long)k->threads, 1e3 * k->seconds,
                      k->seconds > 0.0 ? 1e-6 * (double)k->threads / k->seconds : 0.0, k->making);
    }
    (void)fprintf(stderr, "%llu submissions, waited for %.1f ms, the device busy for %.1f ms\n",
                  (unsigned long long)t->submissions, 1e3 * t->waited, 1e3 * gpu->busy);
    (void)pthread_mutex_destroy(&t->mutex);
    kiln_free(&gpu->times);
}
