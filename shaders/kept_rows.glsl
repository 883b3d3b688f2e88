/* Rows (worker/pass/rows.h): a word for the hit of each sample's ray of a point. The row of point x of the chunk is at
 * push.rows, after the rows before it. Each begins with a word that only the host uses. Needs push constants with
 * `rows`, `weights` and `hemisphere`. */
#include "shaders/shared/rows.h"

KILN_ARRAY(RowWords, uint, 4);
KILN_ARRAY(RowWeights, vec2, 4);

uint64_t row_address, row_weight_address; /* of the thread's point: its first sample's word, and its weights */
uint row_word;                            /* of the ray */
vec2 row_weights;                         /* about the geometric and about the shading normal */

void row_begin(uint x)
{
    row_address = push.rows + 4ul + uint64_t(x) * uint64_t(4u * (1u + push.hemisphere.samples));
    row_weight_address = push.weights + uint64_t(x) * uint64_t(8u * push.hemisphere.samples);
}

void row_keep(uint k)
{
    RowWords(row_address).at[k] = row_word;
    if (HAS_SMOOTH != 0u && push.weights != 0ul)
        RowWeights(row_weight_address).at[k] = row_weights;
}
