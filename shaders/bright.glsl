/* Additions to gather.glsl for rays to bright patches (worker/pass/directions.h), instead of directions.glsl. push.set:
 * struct kiln_gpu_bright. In the order of samples each quarter has equal numbers of both kinds of rays. bright_u and
 * bright_v are the bits of the ray's random numbers. */
#include "shaders/real.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer BrightRef { kiln_gpu_bright value; };
KILN_ARRAY(BrightReceivers, kiln_gpu_bright_receiver, 4);
KILN_ARRAY(BrightPatches, kiln_gpu_bright_patch, 4);
KILN_ARRAY(BrightClusters, uvec2, 4);
#ifdef KILN_DOUBLES
#    define REAL_BYTES 8
#else
#    define REAL_BYTES 4
#endif
KILN_ARRAY(BrightReals, real, REAL_BYTES);

const real SPREAD = KILN_RATIO(8, 5); /* KILN_BRIGHT_SPREAD */

kiln_gpu_bright bright; /* and of the thread's point: */
uint by_cosine;
uint64_t sums_at;
real to_patches; /* its share of rays to patches */
/* of the ray */
float set_weight;
bool is_to_patch, leads;
uint aimed_at; /* the cluster */

void bright_begin(uint x)
{
    bright = BrightRef(push.set).value;
    const kiln_gpu_bright_receiver r = BrightReceivers(bright.receivers).at[WordArray(bright.receiver_of).at[x]];
    by_cosine = r.by_cosine;
    to_patches = real(push.hemisphere.samples - by_cosine) / real(push.hemisphere.samples);
    sums_at = bright.sums + uint64_t(r.row) * bright.count * REAL_BYTES;
}

/* The sample that comes i-th. */
uint bright_number(uint i)
{
    const uint others = push.hemisphere.samples - by_cosine;
    for (uint q = 0u; q < 4u; q++) {
        const uint first = kiln_quarter_first(q, by_cosine), some = kiln_quarter_first(q + 1u, by_cosine) - first;
        const uint other = kiln_quarter_first(q, others), more = kiln_quarter_first(q + 1u, others) - other;
        if (i < some)
            return first + i;
        i -= some;
        if (i < more)
            return by_cosine + other + i;
        i -= more;
    }
    return 0u;
}

/* Index of the first cumulative sum above x. */
uint find_sum(real x)
{
    BrightReals sums = BrightReals(sums_at);
    uint low = 0u, high = bright.count - 1u;
    while (low < high) {
        const uint middle = low + (high - low) / 2u;
        if (sums.at[middle] > x)
            high = middle;
        else
            low = middle + 1u;
    }
    return low;
}

/* Chooses a point by u in (0, 1); u becomes a new random number in (0, 1). */
uint choose_patch(inout real u)
{
    BrightReals sums = BrightReals(sums_at), powers = BrightReals(bright.power);
    WordArray members = WordArray(bright.members);
    const real x = u * sums.at[bright.count - 1u];
    aimed_at = find_sum(x);
    const real before = aimed_at > 0u ? sums.at[aimed_at - 1u] : real(0);
    const uvec2 range = BrightClusters(bright.clusters).at[aimed_at];
    real left = (x - before) / (sums.at[aimed_at] - before) * BrightReals(bright.cluster_power).at[aimed_at];
    uint i = range.x;
    real power = powers.at[members.at[i]];
    while (i + 1u < range.y && left >= power) {
        left -= power;
        i++;
        power = powers.at[members.at[i]];
    }
    u = power > 0 ? clamp(left / power, real(0), real(1)) : KILN_RATIO(1, 2);
    return members.at[i];
}

vec3 set_direction(vec3 axis, vec3 position, float u, float v, out float cosine)
{
    is_to_patch = set_sample >= by_cosine;
    leads = true;
    set_weight = is_to_patch ? 0.0 : float(1 / (1 - to_patches));
    if (!is_to_patch)
        return hemisphere_cosine(axis, u, v, cosine);
    real along = real_unit(bright_u);
    const real across = real_unit(bright_v);
    const kiln_gpu_bright_patch to = BrightPatches(bright.patches).at[choose_patch(along)];
    const vec3 place = to.place + to.edge_s * float(SPREAD * (along - KILN_RATIO(1, 2))) +
                       to.edge_t * float(SPREAD * (across - KILN_RATIO(1, 2))),
               way = place - position;
    const float apart = sqrt(dot(way, way));
    const vec3 direction = apart > 0.0 ? way * (1.0 / apart) : axis;
    cosine = dot(direction, axis);
    leads = apart > 0.0 && cosine > 0.0;
    return direction;
}

/* Density of a ray at the parallelogram of a patch: squared distance over area and cosine. 0: the ray misses it. */
real density_to(kiln_gpu_bright_patch patch_, real3 origin, real3 w)
{
    const real3 s = SPREAD * real3(patch_.edge_s), t = SPREAD * real3(patch_.edge_t), normal = cross(s, t),
                to = real3(patch_.place) - origin;
    const real square = dot(normal, normal), along = dot(normal, w), apart = dot(normal, to) / along;
    if (!(dot(real3(patch_.normal), w) < 0) || !(apart > 0))
        return real(0);
    const real3 at = w * apart - to;
    const real a = dot(cross(at, t), normal) / square, b = dot(cross(s, at), normal) / square;
    return abs(a) <= KILN_RATIO(1, 2) && abs(b) <= KILN_RATIO(1, 2) ? apart * apart / abs(along) : real(0);
}

/* Density q of worker/pass/directions.h, for a ray that has hit a point of a cluster. */
real density_of(vec3 origin, vec3 direction, uint cluster)
{
    BrightReals sums = BrightReals(sums_at), powers = BrightReals(bright.power);
    WordArray members = WordArray(bright.members);
    const uvec2 range = BrightClusters(bright.clusters).at[cluster];
    const real chance =
        (sums.at[cluster] - (cluster > 0u ? sums.at[cluster - 1u] : real(0))) / sums.at[bright.count - 1u];
    real sum = real(0);
    for (uint i = range.x; i < range.y && chance > 0; i++) {
        const real power = powers.at[members.at[i]];
        if (power > 0)
            sum += power * density_to(BrightPatches(bright.patches).at[members.at[i]], real3(origin), real3(direction));
    }
    return sum > 0 ? chance * sum / BrightReals(bright.cluster_power).at[cluster] : real(0);
}

/* Sets the weight of a ray that has hit a point. */
void bright_weigh(uint point, vec3 origin, vec3 direction, float cosine)
{
    const uint cluster = WordArray(bright.cluster_of).at[point];
    if (!(to_patches > 0) || cluster == KILN_GPU_NONE || (is_to_patch && aimed_at != cluster))
        return;
    const real q = density_of(origin, direction, cluster), c = real(cosine) / KILN_REAL_PI;
    if (q > 0 && c > 0)
        set_weight = float(1 / (1 - to_patches + to_patches * q / c));
}
