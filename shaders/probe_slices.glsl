/* Sums of the slices of probes in device memory: KILN_GPU_PROBE_FLOATS floats each, as push.slices says. Before it
 * stand `struct Sums` and what the kernel does (RAYS). */
KILN_ARRAY(SliceArray, float, 4);

SliceArray slice_floats(uint slice)
{
    return SliceArray(push.slices + uint64_t(slice * KILN_GPU_PROBE_FLOATS) * push.count * 4ul);
}

/* The light that the kernel of the rays has found. */
void load(inout Sums sums, uint x, uint slice)
{
    SliceArray floats = slice_floats(slice);
    for (uint c = 0u; c < 3u; c++) {
        for (uint i = 0u; i < KILN_HARMONICS; i++)
            sums.radiance[i][c] = floats.at[(3u * i + c) * push.count + x];
        for (uint i = 0u; i < 6u; i++)
            sums.axes[i][c] = floats.at[(27u + 3u * i + c) * push.count + x];
    }
}

void store(Sums sums, uint x, uint slice)
{
    SliceArray floats = slice_floats(slice);
    for (uint c = 0u; c < 3u; c++) {
        for (uint i = 0u; i < KILN_HARMONICS; i++)
            floats.at[(3u * i + c) * push.count + x] = sums.radiance[i][c];
        for (uint i = 0u; i < 6u; i++)
            floats.at[(27u + 3u * i + c) * push.count + x] = sums.axes[i][c];
    }
    if (RAYS || sums.stopped)
        floats.at[45u * push.count + x] = sums.distance / float(push.samples);
    if (RAYS)
        floats.at[46u * push.count + x] = sums.back / float(push.samples);
    floats.at[47u * push.count + x] = sums.rays;
}
