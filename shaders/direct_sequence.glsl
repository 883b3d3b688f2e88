/* Random numbers of the direct pass: direct_rays.glsl, direct_pilot.comp. */

/* One sequence of samples: of a choice at a point. */
struct Sequence {
    uint seed, shift; /* hashes of the tile and of the texel with the choice's identity */
};

Sequence sequence_of(kiln_gpu_point p, uint identity)
{
    return Sequence(kiln_hash2(p.tile_key, identity), kiln_hash2(p.key, identity));
}

uint draw(Sequence sequence, uint k, uint dimension)
{
    const uint point = DirectWords(push.pass.sobol).at[dimension * push.pass.sobol_stride + k];
    return kiln_owen_scramble(point, kiln_hash2(sequence.seed, dimension)) ^ kiln_hash2(sequence.shift, dimension);
}
