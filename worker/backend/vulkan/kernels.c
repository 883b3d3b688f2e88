/* The device's kernels. Some drivers take a second to compile one, on a single core. So kernels that will certainly be
 * needed are compiled by threads, one each, and passes wait for those they use. */
#include <string.h>

#include "worker/backend/vulkan/vulkan.h"
#include "worker/base/memory.h"
#include "worker/base/thread.h"

/* A kernel that a thread makes. */
struct vulkan_maker {
    pthread_t thread;
    struct gpu *gpu;
    struct gpu_kernel_params params;
    uint32_t constants[VULKAN_CONSTANTS];
    struct gpu_kernel *kernel; /* NULL: that failed */
    double begin, end;         /* kiln_clock_seconds */
};

/* ---- what a kernel is made of ---- */

static const struct gpu_hit_shaders hit_shaders = {
    .closest_hit = VULKAN_CODE(trace_rchit), .any_hit = VULKAN_CODE(trace_rahit), .miss = VULKAN_CODE(trace_rmiss)};

static bool asks_for(const struct gpu_code *code, uint32_t number) { return (code->asked >> number & 1u) != 0; }

static bool is_pipeline(const struct vulkan_backend *b, const struct vulkan_shader *s)
{
    return b->tracer.acceleration != NULL && s->pipeline != NULL;
}

static const struct gpu_code *code_of(const struct vulkan_backend *b, const struct vulkan_shader *s)
{
    const bool pipeline = is_pipeline(b, s), plain = !b->float64 && s->compute_float != NULL;
    return pipeline ? (plain ? s->pipeline_float : s->pipeline) : plain ? s->compute_float : s->compute;
}

/* Describes a kernel. Constants that compute kernels declare but do not use are 0, so that kernels cached for one scene
 * serve others. */
static struct gpu_kernel_params describe(const struct vulkan_backend *b, const struct vulkan_kernel *k,
                                         uint32_t constants[VULKAN_CONSTANTS])
{
    const struct vulkan_shader *s = k->shader;
    const struct gpu_code *code = code_of(b, s);
    const bool pipeline = is_pipeline(b, s);
    memcpy(constants, b->constants, sizeof b->constants);
    constants[VULKAN_DRAW_AGAIN] = k->draw_again;
    constants[VULKAN_OWN] = k->own;
    constants[VULKAN_HAS_VARIED] = b->materials.varied;
    constants[VULKAN_HAS_GLOSSY] = b->materials.gloss;
    constants[VULKAN_HAS_BRUSHED] = b->materials.brushed;
    constants[VULKAN_HAS_TRAPPED] = b->materials.trapped;
    constants[VULKAN_LOBE_KINDS] = b->materials.lobe_kinds;
    constants[VULKAN_TEXTURED] = b->materials.textured;
    for (uint32_t i = 0; i < VULKAN_CONSTANTS && !pipeline; i++)
        if (constants[i] != 0 && !asks_for(code, i))
            constants[i] = 0;
    return (struct gpu_kernel_params){.name = s->name,
                                      .code = code,
                                      .constants = constants,
                                      .constant_count = VULKAN_CONSTANTS,
                                      .hit_shaders = pipeline ? &hit_shaders : NULL};
}

/* ---- makers ---- */

static void *make_one(void *context)
{
    struct vulkan_maker *m = context;
    m->begin = kiln_clock_seconds();
    m->params.constants = m->constants;
    (void)gpu_kernel_create(m->gpu, &m->kernel, &m->params, NULL);
    m->end = kiln_clock_seconds();
    return NULL;
}

/* False: no thread makes it. */
static bool start_maker(struct vulkan_backend *b, struct vulkan_kernel *k)
{
    if (kiln_allocate(&k->maker, 1, sizeof *k->maker, "the maker of a kernel", NULL) != KILN_OK)
        return false;
    k->maker->gpu = b->gpu;
    k->maker->params = describe(b, k, k->maker->constants);
    if (!kiln_thread_start(&k->maker->thread, make_one, k->maker))
        kiln_free(&k->maker);
    return k->maker != NULL;
}

/* Takes a kernel in among the slowest, if it is one. */
static void note(struct vulkan_backend *b, const struct gpu_kernel_params *params, double seconds)
{
    struct kiln_made_kernel made = {
        .name = params->name, .constant_count = (uint32_t)params->constant_count, .seconds = seconds};
    memcpy(made.constants, params->constants, params->constant_count * sizeof *made.constants);
    for (size_t i = 0; i < KILN_MADE_KERNELS; i++)
        if (b->slowest[i].name == NULL || b->slowest[i].seconds < made.seconds) {
            const struct kiln_made_kernel next = b->slowest[i];
            b->slowest[i] = made;
            made = next;
        }
}

/* Waits for the thread that compiles the kernel, if there is one. */
static void join(struct vulkan_backend *b, struct vulkan_kernel *k)
{
    struct kiln_aside *a = &b->making;
    struct vulkan_maker *m = k->maker;
    if (m == NULL)
        return;
    const double start = kiln_clock_seconds();
    (void)pthread_join(m->thread, NULL);
    a->waited += kiln_clock_seconds() - start;
    a->begin = a->count == 0 || m->begin < a->begin ? m->begin : a->begin;
    a->end = m->end > a->end ? m->end : a->end;
    a->count++;
    k->kernel = m->kernel;
    if (k->kernel != NULL)
        note(b, &m->params, m->end - m->begin);
    kiln_free(&k->maker);
}

/* ---- kernels ---- */

/* The variant of a shader for this scene. */
static const struct vulkan_shader *variant_of(const struct vulkan_backend *b, const struct vulkan_shader *shader)
{
    return b->materials.gloss && shader->gloss != NULL ? shader->gloss : shader;
}

static struct vulkan_kernel *find_kernel(const struct vulkan_backend *b, const struct vulkan_shader *shader,
                                         bool draw_again, uint32_t own)
{
    for (size_t i = 0; i < b->kernel_count; i++)
        if (b->kernels[i].shader == shader && b->kernels[i].draw_again == draw_again && b->kernels[i].own == own)
            return &b->kernels[i];
    return NULL;
}

/* Adds an entry without a kernel. */
static int add_kernel(struct vulkan_backend *b, const struct vulkan_kernel *k, struct vulkan_kernel **added,
                      struct kiln_error *error)
{
    const int status =
        kiln_grow(&b->kernels, &b->kernel_room, b->kernel_count + 1, sizeof *b->kernels, "the device's kernels", error);
    if (status != KILN_OK)
        return status;
    *added = &b->kernels[b->kernel_count++];
    **added = *k;
    return KILN_OK;
}

/* Waits for the compiling thread; if it failed, compiles again, to get the error. */
static int make_now(struct vulkan_backend *b, struct vulkan_kernel *k, struct kiln_error *error)
{
    uint32_t constants[VULKAN_CONSTANTS];
    const struct vulkan_once once = vulkan_once_begin();
    int status = KILN_OK;
    join(b, k);
    if (k->kernel == NULL) {
        const struct gpu_kernel_params params = describe(b, k, constants);
        const double begin = kiln_clock_seconds();
        status = gpu_kernel_create(b->gpu, &k->kernel, &params, error);
        if (status == KILN_OK)
            note(b, &params, kiln_clock_seconds() - begin);
    }
    vulkan_once_end(b, once);
    return status;
}

int vulkan_kernel_of(struct vulkan_backend *b, const struct vulkan_shader *shader, bool draw_again, uint32_t own,
                     struct gpu_kernel **kernel, struct kiln_error *error)
{
    shader = variant_of(b, shader);
    struct vulkan_kernel *found = find_kernel(b, shader, draw_again, own);
    const struct vulkan_kernel k = {.shader = shader, .draw_again = draw_again, .own = own};
    *kernel = NULL;
    int status = found != NULL ? KILN_OK : add_kernel(b, &k, &found, error);
    if (status == KILN_OK)
        status = make_now(b, found, error);
    if (status == KILN_OK)
        found->ran = true;
    else if (found != NULL)
        *found = b->kernels[--b->kernel_count];
    if (status == KILN_OK)
        *kernel = found->kernel;
    return status;
}

void vulkan_forget_kernels(struct vulkan_backend *b)
{
    for (size_t i = 0; i < b->kernel_count; i++) {
        join(b, &b->kernels[i]);
        gpu_kernel_destroy(b->gpu, &b->kernels[i].kernel);
    }
    b->kernel_count = 0;
}

/* ---- ahead ---- */

bool vulkan_has_makers(const struct vulkan_backend *b)
{
    return (!gpu_about(b->gpu)->software || b->faults.wanted.makers) && b->tracer.acceleration == NULL &&
           b->faults.wanted.kind == KILN_DEVICE_FAULT_NONE;
}

/* Starts a thread that compiles a kernel, if it is missing. After a failure it is compiled, and the error reported, at
 * first use. */
static void make_wish(struct vulkan_backend *b, const struct vulkan_wish *wish)
{
    const struct vulkan_kernel k = {
        .shader = variant_of(b, wish->shader), .draw_again = wish->draw_again, .own = wish->own};
    struct vulkan_kernel *added;
    if (find_kernel(b, k.shader, k.draw_again, k.own) == NULL && add_kernel(b, &k, &added, NULL) == KILN_OK &&
        !start_maker(b, added))
        b->kernel_count--;
}

bool vulkan_hangs_on_surface(const struct vulkan_backend *b, const struct vulkan_wish *wish)
{
    const struct gpu_code *code = code_of(b, variant_of(b, wish->shader));
    return asks_for(code, VULKAN_HAS_DIVIDED) || asks_for(code, VULKAN_HAS_OCTREE);
}

void vulkan_kernels_at_once(struct vulkan_backend *b, const struct vulkan_wish *wishes, size_t count)
{
    for (size_t i = 0; i < count && wishes[i].shader != NULL && vulkan_has_makers(b); i++)
        make_wish(b, &wishes[i]);
}
