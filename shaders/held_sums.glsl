/* Sums of power of light that stays on the device: each thread sets what its point adds, in whole units, so that no
 * order counts, and each workgroup of 64 leaves its own sums; held_powers.comp adds these up. Needs held.glsl. */
const uint THREADS = 64u, POWERS = KILN_GPU_HELD_POWERS, SHARES = THREADS / POWERS;
const uint INCIDENT = 0u, REFLECTED = 3u, SENT = 6u, ESCAPED = 9u, BLOCKED = 12u, VARIANCE = 15u;

/* Sum k of thread t at k * ROW + t: threads that go on together write, and read, in different banks. */
const uint ROW = THREADS + 1u;
shared int64_t high[ROW * POWERS], low[ROW * POWERS];

/* Of each thread, first: its point adds nothing. */
void no_powers()
{
    for (uint k = 0u; k < POWERS; k++)
        high[k * ROW + gl_LocalInvocationID.x] = low[k * ROW + gl_LocalInvocationID.x] = int64_t(0);
}

/* kiln_exact_add: the whole number of units next to 0, by the double's own bits, since conversions to 64 bits are not
 * the same on all devices. */
void set_power(uint k, double value, double per_unit)
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
    high[at] = negative ? -int64_t(above) : int64_t(above);
    low[at] = negative ? -int64_t(below) : int64_t(below);
}

/* Of all threads: the sums of power that they have set, to the workgroup's place, of a dispatch over so many points. */
void add_up(kiln_gpu_held held, uint light, uint group, uint points)
{
    const uint lane = gl_LocalInvocationID.x, power = lane / SHARES, share = lane % SHARES;
    int64_t sum[2] = int64_t[2](0, 0);
    barrier();
    const uint each = THREADS / SHARES, from = power * ROW + share * each;
    for (uint t = 0u; t < each; t++) {
        const uint at = from + (t + share * SHARES) % each;
        sum[0] += high[at];
        sum[1] += low[at];
    }
    barrier();
    high[lane] = sum[0];
    low[lane] = sum[1];
    barrier();
    if (share != 0u || group * THREADS >= points || light >= held.count)
        return;
    for (uint i = 1u; i < SHARES; i++) {
        sum[0] += high[lane + i];
        sum[1] += low[lane + i];
    }
    const uint64_t at = uint64_t(group * held.count + light) * uint64_t(POWERS) + uint64_t(power);
    HeldPowers(held.parts + at * 16ul).at[0] = kiln_gpu_held_power(uint64_t(sum[0]), uint64_t(sum[1]));
}
