/* Sums of power of light that stays on the device. Each thread sums up points under one light, in integer units, so
 * that the order does not matter. Each workgroup of 64 threads stores its own sums; held_powers.comp adds these up.
 * Needs held.glsl, and before it a constant LANES, a power of two: the number of lights of a workgroup; thread t is for
 * light t % LANES. */
const uint THREADS = 64u, POWERS = KILN_GPU_HELD_POWERS;
const uint INCIDENT = 0u, REFLECTED = 3u, SENT = 6u, ESCAPED = 9u, BLOCKED = 12u, VARIANCE = 15u;

/* Sum k of thread t is at k * ROW + t: threads that run together access different banks. */
const uint ROW = THREADS + 1u;
shared int64_t high[ROW * POWERS], low[ROW * POWERS];

/* Clears the thread's sums. Each thread calls this first. */
void no_powers()
{
    for (uint k = 0u; k < POWERS; k++)
        high[k * ROW + gl_LocalInvocationID.x] = low[k * ROW + gl_LocalInvocationID.x] = int64_t(0);
}

/* kiln_exact_add: truncates to an integer number of units, by the bits of the double, since conversions to 64 bits
 * differ between devices. */
void add_power(uint k, double value, double per_unit)
{
    precise const double steps = value * per_unit;
    const uvec2 words = unpackDouble2x32(steps);
    const int exponent = int(words.y >> 20 & 0x7ffu) - 1075;
    uint64_t digits = packUint2x32(uvec2(words.x, words.y & 0xfffffu | 0x100000u));
    if (exponent < 0)
        digits = exponent > -53 ? digits >> -exponent : 0ul;
    const int up = max(exponent, 0), down = max(40 - up, 0);
    const uint64_t above = up > 40 ? digits << (up - 40) : digits >> down;
    const uint64_t below = (digits & ((1ul << down) - 1ul)) << min(up, 40);
    const uint at = k * ROW + gl_LocalInvocationID.x;
    const bool negative = words.y >> 31 != 0u;
    high[at] += negative ? -int64_t(above) : int64_t(above);
    low[at] += negative ? -int64_t(below) : int64_t(below);
}

/* Stores the sums of power of the workgroup's points (group number `group`) under lights `first` to `first` + LANES -
 * 1. All threads take part. */
void add_up(kiln_gpu_held held, uint first, uint group)
{
    barrier();
    for (uint sum = gl_LocalInvocationID.x; sum < LANES * POWERS; sum += THREADS) {
        const uint lane = sum / POWERS, power = sum % POWERS, light = first + lane;
        int64_t all[2] = int64_t[2](0, 0);
        if (light >= held.count)
            continue;
        for (uint t = lane; t < THREADS; t += LANES) {
            all[0] += high[power * ROW + t];
            all[1] += low[power * ROW + t];
        }
        HeldPowers(held.parts + (uint64_t(group * held.count + light) * uint64_t(POWERS) + uint64_t(power)) * 16ul)
            .at[0] = kiln_gpu_held_power(uint64_t(all[0]), uint64_t(all[1]));
    }
}
