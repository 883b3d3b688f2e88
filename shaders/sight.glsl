/* Stored visibility of pairs of patches (worker/backend/vulkan/visibility.h): layout of a tile run's words. */
KILN_ARRAY(Words, uint, 4);
KILN_ARRAY(SightRuns, kiln_gpu_sight_run, 8);
layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer SightRef { kiln_gpu_sight value; };

/* Offset of the partial words, for `groups` groups. */
uint kiln_partial_at(uint groups) { return 2u * groups; }
uint kiln_bits_at(uint groups) { return 4u * groups; }
uint kiln_found_at(uint groups) { return 5u * groups; }

/* Address of the visibility bits of a tile pair, by its number among pairs with bits. `half_word`: 0 or 1 of a point's
 * two words. */
uint64_t kiln_pair_bits(kiln_gpu_sight_run run, uint groups, uint number, uint place, uint half_word)
{
    return run.words + 24ul * groups + 4ul * ((uint64_t(number) * run.count + place) * 2ul + half_word);
}

uint64_t kiln_open_word(uint64_t open, uint word, uint total, uint x)
{
    return open + 4ul * (uint64_t(word) * total + x);
}
