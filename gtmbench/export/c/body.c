/* ---- small things ---- */

#define SCALE 320.0f /* of a stored sample: +-100 deviations are +-32000 */
#define MOST 100.0f
#define FIRST 14u      /* blocks that the noise is learnt on at first */
#define SPAN 40u       /* blocks that level, colour and tail are learnt from */
#define TOO_YOUNG 16u  /* blocks that don't tell of steadiness yet */
#define GAP 1u
#define GROUP 34u
#define ORDER GTM_MONITOR_ORDER
#define BLOCK GTM_MONITOR_BLOCK
#define NAMES ((size_t)ORDER + 9u) /* columns of a recent block */
#define LONGEST WINDOW_ROWS[GTM_MONITOR_WINDOWS - 1u]
#define STAGES 3u /* of learning anew */
#define LEARNS_AT_ONCE (BLOCK < 4u * STAGES * GTM_MONITOR_RESIDUALS) /* up to 4 rows a call are judged at first */
#define LEAST_POWER (0.5f * (float)(1u << GTM_MONITOR_SQUARE_SHIFT) / (SCALE * SCALE)) /* squares of less are stored as 0 */
#define FLOOR 0.0025f
#define LEAST 0.005f
/* once a window and residual: a call each would cost a seventh more, but compiled for size it is one function */
#if defined(__GNUC__) && !defined(__OPTIMIZE_SIZE__)
#define INLINE inline __attribute__((always_inline))
#else
#define INLINE inline
#endif
#if GTM_MONITOR_COMPACT
#define BASE_SHARE (1.0f / ((float)GTM_MONITOR_BASE_BLOCKS * SCALE))
#define BASE_BACK 0u
#else
#define BASE_SHARE (1.0f / ((float)GTM_MONITOR_BASELINE * SCALE))
#define BASE_BACK GTM_MONITOR_BASELINE
#endif
#define UNSTEADIEST 9.0f /* times the power that was learnt: noise that wanders so far is a fault */

enum { WAITING, CENTRING, CONVERTING, SIZING, COLOURING, TAILING, WHITENING, FOLLOWING };
enum { COUNT, SIZE, FOURTH, SUM, CLIPPED, LAGS = 8 };              /* columns of recent blocks */
enum { SLOW, FAST, LOW, SQUARES, FOURTHS, MEANS, ALL_LATE = 10 };  /* of late ones */
enum { OLD_SUM = 10, OLD_MOMENT = 11, ALL_OLD = 12 };              /* and of groups of old ones */
enum { SHARE, SHARE_OF_SQUARES, NEAR, QUIET, LOUD, ENOUGH, ALL_TESTS = 7 }; /* of windows; nats of mean and of energy */

static const float CLIPS[4] = {2.5f, 3.0f, 3.5f, 4.0f};
static const uint16_t MEAN_BLOCKS[5] = {1u, 2u, 4u, 8u, 16u};
static const float NO_TOLERANCE[3] = {0.0f, 1.0f, 1.0f};

static float largest(float a, float b) { return a > b ? a : b; }
static float least(float a, float b) { return a < b ? a : b; }
static float within(float value, float most) { return value > most ? most : value < -most ? -most : value; }
static float filled(float value) { return isfinite(value) ? value : 0.0f; }
static int32_t nearest(float value) { return (int32_t)(value < 0.0f ? value - 0.5f : value + 0.5f); }

/* A float's upper half, rounded: eight bits of mantissa, whose rounding averages out over many blocks. */
static uint16_t packed(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits += 0x7FFFu + ((bits >> 16) & 1u);
    return (uint16_t)(bits >> 16);
}

static float unpacked(uint16_t half)
{
    uint32_t bits = (uint32_t)half << 16;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* The sum of taps, for the oldest first, times a ring's values. Tables hold their taps twice, so those that belong to the
 * ring's places in their order stand side by side. */
static float dot(const float *taps, const float *ring, unsigned count, unsigned newest)
{
    const float *tap = taps + (count - 1u - newest), *value = ring;
    float sum = 0.0f;
    for (; count >= 4u; count -= 4u, tap += 4, value += 4) {
        sum += tap[0] * value[0];
        sum += tap[1] * value[1];
        sum += tap[2] * value[2];
        sum += tap[3] * value[3];
    }
    for (; count > 0u; count--) {
        sum += *tap++ * *value++;
    }
    return sum;
}

static uint16_t next_of(unsigned at, unsigned count) { return (uint16_t)(at + 1u < count ? at + 1u : 0u); }

static void nothing(float *values, unsigned count)
{
    for (unsigned i = 0u; i < count; i++) {
        values[i] = NAN;
    }
}

/* ---- whitened samples ---- */

static uint32_t place_before(uint32_t at, uint32_t lag) { return at >= lag ? at - lag : at + GTM_MONITOR_RING - lag; }

/* Of a sample, rounded so that a window's sum of them fits 32 bits. */
static uint32_t square_of(int32_t sample)
{
    return ((uint32_t)(sample * sample) + (1u << (GTM_MONITOR_SQUARE_SHIFT - 1u))) >> GTM_MONITOR_SQUARE_SHIFT;
}

/* ---- test statistics ---- */

/* A window's mean is off by `shift` deviations of the noise, which has `variance` by chance; its mean square about the base is
 * `power`. What is told of either is a likelihood ratio in nats. */
typedef struct {
    float rows, shift, power, variance;
} window_state;

static float square_of_shift(const window_state *window, const float *tolerance)
{
    float beyond = largest(fabsf(window->shift) - tolerance[0], 0.0f);
    return beyond * beyond / window->variance;
}

static float nats_of_mean(const gtm_monitor_noise *noise, const window_state *window, float square)
{
    float known = noise->worth + window->rows, inner = largest(window->power - window->shift * window->shift, 0.0f);
    float nats = 0.5f * known * log1pf(square / (noise->worth + window->rows * inner));
    nats = least(nats, square / (2.0f * noise->widened));
    return largest(nats, square / (2.0f * UNSTEADIEST));
}

static float nats_of_energy(const gtm_monitor_noise *noise, const window_state *window, const float *tolerance)
{
    float rows = window->rows, known = noise->worth + rows, high = tolerance[2];
    float ratio = window->power / least(largest(window->power, tolerance[1] * noise->quieter), high * noise->louder);
    float nats = 0.5f * known * log1pf(rows * (ratio - 1.0f) / known) - 0.5f * rows * logf(ratio);
    float loud = window->power / (high * UNSTEADIEST);
    if (loud > 1.0f) {
        nats = largest(nats, 0.5f * rows * (loud - 1.0f - logf(loud)));
    }
    return nats;
}

/* What a window of `rows` with a sum and a sum of squares is about a base: that of `length` samples before it, or where that
 * is 0 the one that was learnt. */
static window_state window_of(const gtm_monitor_noise *noise, const float *test, uint32_t rows, int32_t sum, uint32_t squares,
    float base, uint32_t length)
{
    window_state window;
    float mean = (float)sum * test[SHARE];
    window.rows = (float)rows;
    window.shift = mean - base;
    window.power = (float)squares * test[SHARE_OF_SQUARES] - (mean + window.shift) * base;
    if (length > 0u) {
        window.power = largest(window.power, LEAST_POWER);
        window.variance = 1.0f / window.rows + 1.0f / (float)length + 2.0f * noise->slow;
    } else { /* rows that are missing have no power at all */
        window.power = largest(window.power, 1e-12f);
        window.variance = 1.0f / window.rows + noise->slow;
    }
    return window;
}

/* Whether a ratio of a window is more than enough. Logarithms are dear, so the noise is asked first whether it could be. */
static int is_over(const gtm_monitor_noise *noise, const float *test, const window_state *window, const float *tolerance)
{
    float square = square_of_shift(window, tolerance);
    if (square > 2.0f * noise->widened * test[ENOUGH] && nats_of_mean(noise, window, square) > test[ENOUGH]) {
        return 1;
    }
    return (window->power < tolerance[1] * noise->quieter || window->power > tolerance[2] * noise->louder)
        && nats_of_energy(noise, window, tolerance) > test[ENOUGH + 1];
}

/* Nearly all windows lie where no ratio can be enough, whatever noise was learnt: within NEAR, and between QUIET and LOUD. */
static inline int is_ordinary(const float *test, int32_t sum, uint32_t squares, float base)
{
    float mean = (float)sum * test[SHARE], shift = mean - base;
    float power = (float)squares * test[SHARE_OF_SQUARES] - (mean + shift) * base;
    return fabsf(shift) < test[NEAR] && power > test[QUIET] && power < test[LOUD];
}

/* How many samples a window's baseline has, and the mean of it; 0 where there are too few. */
static uint32_t baseline_of(const gtm_monitor_line *line, unsigned w, float *base)
{
    uint32_t rows = WINDOW_ROWS[w], had = line->count > rows ? line->count - rows : 0u;
    if (had < GTM_MONITOR_LEAST_BASELINE) {
        return 0u;
    }
#if GTM_MONITOR_COMPACT
    uint32_t blocks = had >= GTM_MONITOR_BASE_BLOCKS * GTM_MONITOR_SHORTEST ? GTM_MONITOR_BASE_BLOCKS : had / GTM_MONITOR_SHORTEST;
    if (blocks == 0u) {
        return 0u;
    }
    *base = (float)line->bases[w] / ((float)blocks * SCALE);
    return had < GTM_MONITOR_BASELINE ? had : GTM_MONITOR_BASELINE;
#else
    had = had < GTM_MONITOR_BASELINE ? had : GTM_MONITOR_BASELINE;
    *base = (float)line->bases[w] / ((float)had * SCALE);
    return had;
#endif
}

#if GTM_MONITOR_COMPACT
/* Stored from the end, where no row waits when the first ones come. */
static int16_t *mean_at(gtm_monitor_line *line, uint32_t block)
{
    return &line->store.samples.means[GTM_MONITOR_MEANS_ROOM - 1u - block % GTM_MONITOR_MEANS];
}

static void move_baseline(gtm_monitor_line *line, unsigned w, uint32_t had)
{
    if (had >= GTM_MONITOR_SHORTEST && had % GTM_MONITOR_SHORTEST == 0u) {
        uint32_t blocks = had / GTM_MONITOR_SHORTEST;
        line->bases[w] += *mean_at(line, blocks - 1u);
        if (blocks > GTM_MONITOR_BASE_BLOCKS) {
            line->bases[w] -= *mean_at(line, blocks - 1u - GTM_MONITOR_BASE_BLOCKS);
        }
    }
}
#endif

/* A sample on its way into the windows. */
typedef struct {
    int32_t sample;
    uint32_t square, count, at, base_at;
} arrival;

/* Put a sample into a window; what leaves it goes into its baseline. Return `said`, or 1 where that was 0 and a statistic is
 * above its threshold. Where `is_full`, the window and its baseline are. */
static INLINE int put_in_window(gtm_monitor_line *line, const arrival *arriving, unsigned j, unsigned w, int is_full, int said)
{
    const int16_t *ring = line->store.samples.ring;
    const float *test = TESTS[j] + (size_t)w * ALL_TESTS;
    const uint32_t rows = WINDOW_ROWS[w], had = is_full || arriving->count > rows ? arriving->count - rows : 0u;
    int32_t old = is_full || had > 0u ? ring[place_before(arriving->at, rows)] : 0;
    uint32_t length = GTM_MONITOR_BASELINE;
    int32_t sum = line->sums[w] += arriving->sample - old;
    uint32_t squares = line->squares[w] += arriving->square - square_of(old);
#if GTM_MONITOR_COMPACT
    move_baseline(line, w, had);
#else
    line->bases[w] += is_full || had > GTM_MONITOR_BASELINE ? old - ring[place_before(arriving->base_at, rows)] : old;
#endif
    float base = (float)line->bases[w] * BASE_SHARE;
    if (!is_full && had < GTM_MONITOR_BASELINE) {
        length = baseline_of(line, w, &base);
        if (length == 0u) {
            return said;
        }
    }
    if (is_ordinary(test, sum, squares, base) || said != 0) {
        return said;
    }
    window_state window = window_of(&line->noise, test, rows, sum, squares, base, length);
    return is_over(&line->noise, test, &window, TOLERANCES[j]);
}

/* Put a sample into all windows. Return 1 where a statistic is above its threshold, 0 where none is, -1 where none is known. */
static int put_sample(gtm_monitor_line *line, unsigned j, int32_t sample)
{
    const uint32_t count = ++line->count, at = count > 1u ? next_of(line->ring_at, GTM_MONITOR_RING) : line->ring_at;
    const arrival arriving = {sample, square_of(sample), count, at, place_before(at, BASE_BACK)};
    int said = count < WINDOW_ROWS[0] + GTM_MONITOR_LEAST_BASELINE ? -1 : 0;
    /* the oldest sample is read before the newest takes its place */
    if (count > LONGEST + GTM_MONITOR_BASELINE) {
        for (unsigned w = 0u; w < GTM_MONITOR_WINDOWS; w++) {
            said = put_in_window(line, &arriving, j, w, 1, said);
        }
    } else {
        for (unsigned w = 0u; w < GTM_MONITOR_WINDOWS; w++) {
            said = put_in_window(line, &arriving, j, w, 0, said);
        }
    }
    line->ring_at = (uint16_t)at;
    line->store.samples.ring[at] = (int16_t)sample;
    /* counted modulo all that is asked of it: it never overflows */
#if GTM_MONITOR_COMPACT
    if (count % GTM_MONITOR_SHORTEST == 0u) {
        int32_t sum = line->sums[0], half = (int32_t)GTM_MONITOR_SHORTEST / 2;
        int32_t mean = (sum + (sum < 0 ? -half : half)) / (int32_t)GTM_MONITOR_SHORTEST;
        *mean_at(line, count / GTM_MONITOR_SHORTEST - 1u) = (int16_t)mean;
    }
    if (count >= 2u * GTM_MONITOR_PERIOD) {
        line->count -= GTM_MONITOR_PERIOD;
    }
#else
    if (count > 2u * GTM_MONITOR_RING) {
        line->count -= GTM_MONITOR_RING;
    }
#endif
    return said;
}

/* ---- suspicions: a window that departs from what was learnt stops the learning ---- */

/* Whether no row was missing in any window of suspicions: where those are windows of the tests, too, their sums are the same. */
static int is_whole(const gtm_monitor_line *line, unsigned is_there)
{
    const unsigned last = GTM_MONITOR_SUSPICIONS - 1u;
    return GTM_MONITOR_SUSPICIONS_ARE_WINDOWS && is_there && line->in_window[last] == SUSPICION_ROWS[last];
}

/* Put a row into the windows of suspicions, which count rows: those that are missing read 0. The newest stored sample is
 * that of the row before, up to which nothing may have been missing. */
static void put_row(gtm_monitor_line *line, unsigned is_there, int32_t sample)
{
    const uint32_t square = square_of(sample);
    const unsigned at = line->there_at;
    const int were_same = is_whole(line, 1u);
    for (unsigned w = 0u; w < GTM_MONITOR_SUSPICIONS; w++) {
        if (were_same) {
            line->window_sums[w] = line->sums[SUSPICION_WINDOWS[w]];
            line->window_squares[w] = line->squares[SUSPICION_WINDOWS[w]];
        }
        uint32_t rows = SUSPICION_ROWS[w], held = line->in_window[w];
        unsigned leaves = at >= rows ? at - rows : at + GTM_MONITOR_THERE - rows;
        int32_t old = 0;
        if (held == rows || ((line->there[leaves / 32u] >> (leaves % 32u)) & 1u)) {
            old = line->store.samples.ring[place_before(line->ring_at, held - 1u)];
            held--;
        }
        line->in_window[w] = (uint16_t)(held + is_there);
        line->window_sums[w] += sample - old;
        line->window_squares[w] += square - square_of(old);
    }
    uint32_t bit = 1u << (at % 32u), others = line->there[at / 32u] & ~bit;
    line->there[at / 32u] = is_there ? others | bit : others;
    line->there_at = next_of(at, GTM_MONITOR_THERE);
}

/* The longest window that departs is remembered until the block ends. */
static void suspect_row(gtm_monitor_line *line, int is_same)
{
    const gtm_monitor_noise *noise = &line->noise;
    const float *test = SUSPICIONS;
    for (unsigned w = 0u; w < GTM_MONITOR_SUSPICIONS; w++, test += ALL_TESTS) {
        const uint32_t rows = SUSPICION_ROWS[w];
        int32_t sum = line->window_sums[w];
        uint32_t squares = line->window_squares[w];
        if (is_same) {
            sum = line->sums[SUSPICION_WINDOWS[w]];
            squares = line->squares[SUSPICION_WINDOWS[w]];
        }
        if (!is_ordinary(test, sum, squares, noise->base) && rows > line->suspected) {
            window_state window = window_of(noise, test, rows, sum, squares, noise->base, 0u);
            line->suspected = is_over(noise, test, &window, NO_TOLERANCE) ? (uint16_t)rows : line->suspected;
        }
    }
}

/* ---- what blocks of half a second tell of the noise ---- */

static float column_sum(const uint16_t *first, unsigned count)
{
    float sum = 0.0f;
    for (; count >= 4u; count -= 4u, first += 4u * NAMES) {
        sum += unpacked(first[0]) + unpacked(first[NAMES]) + unpacked(first[2u * NAMES]) + unpacked(first[3u * NAMES]);
    }
    for (; count > 0u; count--, first += NAMES) {
        sum += unpacked(*first);
    }
    return sum;
}

/* Sums of columns from `first` to before `end`, over `count` blocks, of which `newer` ones are younger. */
static void add_recent(const gtm_monitor_blocks *blocks, unsigned newer, unsigned count, unsigned first, unsigned end, float *sums)
{
    unsigned stop = (blocks->recent_next + GTM_MONITOR_RECENT - newer) % GTM_MONITOR_RECENT;
    unsigned early = count > stop ? count - stop : 0u; /* of them stand at the ring's end */
    for (unsigned i = first; i < end; i++) {
        sums[i] = column_sum(&blocks->recent[stop + early - count][i], count - early);
        if (early > 0u) {
            sums[i] += column_sum(&blocks->recent[GTM_MONITOR_RECENT - early][i], early);
        }
    }
}

static unsigned old_blocks(const gtm_monitor_blocks *blocks) { return blocks->group_count * GROUP + blocks->group_blocks; }

/* Sums over the blocks that tell of steadiness; the last is the sum of blocks' sums times their places about the middle. */
static unsigned add_remembered(const gtm_monitor_blocks *blocks, unsigned to_come, float *sums)
{
    unsigned old = old_blocks(blocks), all = old + blocks->late_count + to_come;
    unsigned end = all > 1u + GAP ? all - GAP : 1u;
    unsigned settled = end > TOO_YOUNG + FIRST ? end - TOO_YOUNG : (end < FIRST ? end : FIRST);
    unsigned own = settled > old ? settled - old : 0u;
    unsigned count = old + own;
    float middle = 0.5f * ((float)count - 1.0f);
    for (unsigned i = 0u; i < ALL_OLD; i++) {
        sums[i] = blocks->open_group[i];
    }
    sums[OLD_MOMENT] += sums[OLD_SUM] * ((float)(blocks->group_count * GROUP) - middle);
    for (unsigned g = 0u; g < blocks->group_count; g++) {
        unsigned at = (blocks->group_next + 2u * GTM_MONITOR_GROUPS - blocks->group_count + g) % GTM_MONITOR_GROUPS;
        const uint16_t *row = blocks->groups[at];
        for (unsigned i = 0u; i < ALL_OLD; i++) {
            sums[i] += unpacked(row[i]);
        }
        sums[OLD_MOMENT] += unpacked(row[OLD_SUM]) * ((float)(g * GROUP) - middle);
    }
    for (unsigned k = 0u; k < own; k++) {
        unsigned back = blocks->late_count - k; /* the oldest first */
        const uint16_t *row = blocks->late[(blocks->late_next + 2u * GTM_MONITOR_LATE - back) % GTM_MONITOR_LATE];
        unsigned at = (blocks->recent_next + 2u * GTM_MONITOR_RECENT - back) % GTM_MONITOR_RECENT;
        float sum = unpacked(blocks->recent[at][SUM]);
        for (unsigned i = 0u; i < ALL_LATE; i++) {
            sums[i] += unpacked(row[i]);
        }
        sums[OLD_SUM] += sum;
        sums[OLD_MOMENT] += sum * ((float)(old + k) - middle);
    }
    return count;
}

/* Room for one more late block: the oldest one goes into the sums of a group. */
static void make_old(gtm_monitor_blocks *blocks)
{
    float *group = blocks->open_group;
    unsigned back = blocks->late_count;
    const uint16_t *row = blocks->late[(blocks->late_next + 2u * GTM_MONITOR_LATE - back) % GTM_MONITOR_LATE];
    float sum = unpacked(blocks->recent[(blocks->recent_next + 2u * GTM_MONITOR_RECENT - back) % GTM_MONITOR_RECENT][SUM]);
    for (unsigned i = 0u; i < ALL_LATE; i++) {
        group[i] += unpacked(row[i]);
    }
    group[OLD_SUM] += sum;
    group[OLD_MOMENT] += sum * (float)blocks->group_blocks;
    blocks->late_count--;
    blocks->group_blocks++;
    if (blocks->group_blocks == GROUP) { /* the oldest group is forgotten */
        for (unsigned i = 0u; i < ALL_OLD; i++) {
            blocks->groups[blocks->group_next][i] = packed(group[i]);
            group[i] = 0.0f;
        }
        blocks->group_next = next_of(blocks->group_next, GTM_MONITOR_GROUPS);
        blocks->group_count = (uint16_t)(blocks->group_count < GTM_MONITOR_GROUPS ? blocks->group_count + 1u : GTM_MONITOR_GROUPS);
        blocks->group_blocks = 0u;
    }
}

static void remember(gtm_monitor_blocks *blocks, const float *recent, const float *late)
{
    if (blocks->late_count == GTM_MONITOR_LATE) {
        make_old(blocks);
    }
    for (unsigned i = 0u; i < NAMES; i++) {
        blocks->recent[blocks->recent_next][i] = packed(recent[i]);
    }
    for (unsigned i = 0u; i < ALL_LATE; i++) {
        blocks->late[blocks->late_next][i] = packed(late[i]);
    }
    blocks->recent_next = next_of(blocks->recent_next, GTM_MONITOR_RECENT);
    blocks->late_next = next_of(blocks->late_next, GTM_MONITOR_LATE);
    blocks->recent_count = (uint16_t)(blocks->recent_count < GTM_MONITOR_RECENT ? blocks->recent_count + 1u : GTM_MONITOR_RECENT);
    blocks->late_count++;
}

/* Take out the newest blocks, for they may hold what is suspected; the first ones stay. */
static void take_out(gtm_monitor_blocks *blocks, unsigned count)
{
    unsigned most = blocks->late_count > FIRST ? blocks->late_count - FIRST : 0u;
    if (old_blocks(blocks) > 0u) {
        most = blocks->late_count;
    }
    count = count < most ? count : most;
    blocks->recent_next = (uint16_t)((blocks->recent_next + GTM_MONITOR_RECENT - count) % GTM_MONITOR_RECENT);
    blocks->late_next = (uint16_t)((blocks->late_next + GTM_MONITOR_LATE - count) % GTM_MONITOR_LATE);
    blocks->recent_count = (uint16_t)(blocks->recent_count - count);
    blocks->late_count = (uint16_t)(blocks->late_count - count);
}

/* Level, colour, tail: each stands on those before it. */

static void learn_level(gtm_monitor_noise *noise, const float *sums)
{
    noise->local = largest(sums[SIZE] / largest(sums[COUNT], 1.0f) * 1.2533141f, LEAST);
}

/* Levinson's recursion, to an autoregressive model over its innovations' deviation. */
static void learn_colour(gtm_monitor_noise *noise, const float *sums)
{
    float covariance[ORDER + 1], taps[ORDER + 1], count = largest(sums[COUNT], 1.0f);
    for (unsigned i = 0u; i <= ORDER; i++) {
        covariance[i] = sums[LAGS + i] / count;
        taps[i] = 0.0f;
    }
    covariance[0] = covariance[0] * 1.0001f + FLOOR;
    taps[0] = 1.0f;
    float variance = covariance[0];
    for (unsigned n = 1u; n <= ORDER; n++) {
        float sum = 0.0f, before[ORDER + 1];
        for (unsigned i = 0u; i < n; i++) {
            sum += taps[i] * covariance[n - i];
            before[i] = taps[i];
        }
        float reflection = within(-sum / variance, 0.9999f);
        for (unsigned i = 1u; i <= n; i++) {
            taps[i] += reflection * before[n - i];
        }
        variance *= 1.0f - reflection * reflection;
    }
    float deviation = sqrtf(variance);
    for (unsigned i = 0u; i <= ORDER; i++) {
        noise->taps[i] = taps[i] / deviation;
    }
}

static void learn_tail(gtm_monitor_noise *noise, const float *sums)
{
    float count = largest(sums[COUNT], 1.0f), clipped[4], gain = 0.0f;
    for (unsigned i = 0u; i < 4u; i++) {
        clipped[i] = sums[CLIPPED + i] / count;
    }
    float all = largest(clipped[3], 1e-12f);
    float kurtosis = sums[FOURTH] / count / (all * all);
    float clip = largest(CLIPS[3] - 1.2f * largest(kurtosis - 3.2f, 0.0f), CLIPS[0]);
    unsigned at = clip >= CLIPS[2] ? 2u : clip >= CLIPS[1] ? 1u : 0u;
    float share = (clip - CLIPS[at]) / (CLIPS[at + 1u] - CLIPS[at]);
    float power = clipped[at] * (1.0f - share) + clipped[at + 1u] * share;
    for (unsigned i = 0u; i <= ORDER; i++) {
        gain += noise->taps[i] * noise->taps[i];
    }
    float floored = largest(power + FLOOR * gain, 1e-12f);
    noise->clip = clip;
    noise->scale = 1.0f / sqrtf(floored);
    float silent = 0.5f * logf(largest(power / floored, 1e-6f));
    noise->unsteady = silent * silent; /* at least */
}

static void learn_steadiness(gtm_monitor_noise *noise, const gtm_monitor_blocks *remembered, unsigned to_come)
{
    float sums[ALL_OLD];
    float blocks = (float)add_remembered(remembered, to_come, sums);
    for (unsigned i = 0u; i < ALL_OLD; i++) {
        sums[i] /= blocks;
    }
    /* sigma^2: products of neighbouring powers beyond chance, the tail of short sums, and what isn't known yet */
    float chance = 2.0f / sqrtf(blocks), size = (float)BLOCK, worth = 20.0f / (20.0f + blocks);
    float found = largest(sums[SLOW] - chance / size, sums[FAST] - 4.5f * chance / size);
    found = largest(largest(found, sums[LOW] - 0.16f * chance), 0.0f);
    float squares = largest(sums[SQUARES], 1e-12f);
    float kurtosis = sums[FOURTHS] / (squares * squares) - 2.1908902f * chance;
    float tail = least(largest(kurtosis - 3.0f, 0.0f), 3.0f) / 20.0f;
    float unsteady = found + tail + 0.2f * worth * worth + 1e-3f;
    /* slow noise: the greatest excess of means over what white noise has, a straight line taken out */
    float along = sums[OLD_MOMENT] * blocks;
    float trend = 12.0f * along * along / (blocks * blocks * largest(blocks * blocks - 1.0f, 1.0f));
    float steady = sums[OLD_SUM] * sums[OLD_SUM] + trend, slow = 0.0f;
    for (unsigned i = 0u; i < 5u; i++) {
        float length = (float)MEAN_BLOCKS[i];
        float excess = sums[MEANS + i] - length / size * steady - 1.0f;
        float by_chance = (1.0f + 4.0f * unsteady) * sqrtf(2.0f * length / blocks);
        if (excess > 2.5f * by_chance && 4.0f * length <= blocks) {
            slow = largest(slow, excess / (length * size));
        }
    }
    noise->slow = slow + worth * worth * worth * worth / size;
    noise->unsteady = largest(unsteady, noise->unsteady);
    float sigma = sqrtf(noise->unsteady), wide = expf(2.0f * sigma);
    noise->worth = 2.0f / noise->unsteady;
    noise->widened = least(expf(2.5f * largest(sigma - 0.03f, 0.0f)), UNSTEADIEST);
    noise->quieter = 1.0f / wide;
    noise->louder = least(wide, UNSTEADIEST);
}

/* One of the STAGES of learning what blocks are whitened by once `to_come` more is there: the youngest block is never
 * learnt from, so what the next one is whitened by is known as soon as this one begins. Each stands on those before it. */
static void learn_stage(const gtm_monitor_blocks *blocks, unsigned to_come, unsigned stage, gtm_monitor_noise *noise)
{
    unsigned newer = blocks->recent_count + to_come > 1u ? GAP - to_come : 0u, count = blocks->recent_count - newer;
    float sums[NAMES];
    count = count < SPAN ? count : SPAN;
    if (stage == 0u) {
        add_recent(blocks, newer, count, COUNT, COUNT + 1u, sums);
        add_recent(blocks, newer, count, LAGS, NAMES, sums);
        learn_colour(noise, sums);
    } else if (stage == 1u) {
        add_recent(blocks, newer, count, COUNT, LAGS, sums);
        learn_level(noise, sums);
        learn_tail(noise, sums);
        noise->base = sums[SUM] / largest(sums[COUNT], 1.0f);
    } else {
        learn_steadiness(noise, blocks, to_come);
    }
}

static void learn_all(const gtm_monitor_blocks *blocks, unsigned to_come, gtm_monitor_noise *noise)
{
    for (unsigned stage = 0u; stage < STAGES; stage++) {
        learn_stage(blocks, to_come, stage, noise);
    }
}

/* Learn, where that is due: it is dear, so one residual does it in a call, or a stage of it where a block has calls enough. */
static void learn_due(gtm_monitor_line *line, unsigned *may_learn)
{
    if (*may_learn == 0u || line->phase != FOLLOWING) {
        return;
    }
    if (line->is_due) {
        learn_all(&line->blocks, 0u, &line->noise);
        line->is_due = 0u;
        *may_learn = 0u;
    } else if (!line->is_held && line->stages < STAGES && line->row_in_block > 0u) {
        do {
            learn_stage(&line->blocks, 1u, line->stages, &line->next);
            line->stages++;
        } while (LEARNS_AT_ONCE && line->stages < STAGES);
        *may_learn = 0u;
    }
}

/* ---- from a row behind the calibrated filter to a whitened sample ---- */

static void open_block(gtm_monitor_line *line)
{
    memset(&line->open, 0, sizeof line->open);
    line->row_in_block = 0u;
    line->suspected = 0u;
}

static void end_nothing(gtm_monitor_line *line)
{
    memset(line->lagged, 0, sizeof line->lagged);
    memset(line->powers, 0, sizeof line->powers);
    memset(line->block_sums, 0, sizeof line->block_sums);
    line->burst = 0.0f;
}

static void measure_size(gtm_monitor_line *line, float x)
{
    if (isfinite(x)) {
        line->open.count += 1.0f;
        line->open.size += least(fabsf(x), 30.0f * line->typical);
    }
}

static void measure_colour(gtm_monitor_line *line, float x)
{
    float own = within(filled(x), CLIPS[3] * line->noise.local);
    float *lagged = line->lagged, *sums = line->open.lags, newer = own;
    for (unsigned lag = 0u; lag <= ORDER; lag += 2u) {
        float older = lagged[lag], oldest = lagged[lag + 1u];
        lagged[lag] = newer;
        lagged[lag + 1u] = older;
        sums[lag] += own * newer;
        sums[lag + 1u] += own * older;
        newer = oldest;
    }
}

static void measure_tail(gtm_monitor_line *line, float y)
{
    float own = filled(y), square = own * own;
    if (square <= CLIPS[0] * CLIPS[0]) {
        line->open.within_all += square;
    } else {
        for (unsigned i = 0u; i < 4u; i++) {
            float clipped = within(own, CLIPS[i]);
            square = clipped * clipped;
            line->open.beyond[i] += square;
        }
    }
    line->open.fourth += square * square;
}

static void measure_power(gtm_monitor_line *line, float z)
{
    float own = filled(z);
    unsigned part = line->row_in_block / (BLOCK / 5u);
    line->open.sum += own;
    line->open.squares += own * own;
    if (part < 5u) {
        line->open.part_sums[part] += own;
        line->open.part_squares[part] += own * own;
    }
}

static uint32_t sizes_upto(const gtm_monitor_line *line, uint32_t code)
{
    uint32_t count = 0u;
    for (unsigned i = 0u; i < GTM_MONITOR_LASTING; i++) {
        count += line->sizes[i] <= code ? 1u : 0u;
    }
    return count;
}

/* One and a half times the median of the last sizes, where it is more than `clip`: what is as loud for longer is no
 * outlier. Codes of sizes are in their order, so the median is found by halving, and only as far as `size` is clipped. */
static float lasting(const gtm_monitor_line *line, float clip, float size)
{
    const uint32_t half = (GTM_MONITOR_LASTING + 1u) / 2u;
    uint32_t low = packed(clip / 1.5f), high = packed(size / 1.5f), above = 0xFFFFu;
    if (sizes_upto(line, low) > half) {
        return clip;
    }
    if (sizes_upto(line, high) < half) {
        return size;
    }
    while (low < high) {
        uint32_t middle = (low + high) / 2u;
        if (sizes_upto(line, middle) >= half) {
            high = middle;
        } else {
            low = middle + 1u;
        }
    }
    float median = unpacked((uint16_t)low);
    if (GTM_MONITOR_LASTING % 2u == 0u && sizes_upto(line, low) == half) {
        for (unsigned i = 0u; i < GTM_MONITOR_LASTING; i++) {
            above = line->sizes[i] > low && line->sizes[i] < above ? line->sizes[i] : above;
        }
        median = above < 0xFFFFu ? 0.5f * (median + unpacked((uint16_t)above)) : median;
    }
    return largest(clip, 1.5f * median);
}

/* Behind both filters; NaN where a row that it needs is missing. */
static float behind_both(gtm_monitor_line *line, float x)
{
    const float *taps = line->noise.taps;
    float *second = line->second, newer = x, sum = 0.0f;
    for (unsigned lag = 0u; lag < ORDER; lag += 2u) {
        float older = second[lag], oldest = second[lag + 1u];
        second[lag] = newer;
        second[lag + 1u] = older;
        sum += taps[lag] * newer;
        sum += taps[lag + 1u] * older;
        newer = oldest;
    }
    if (ORDER % 2u == 0u) {
        second[ORDER] = newer;
        sum += taps[ORDER] * newer;
    }
    return sum;
}

/* Clipped and of variance 1. After a gross outlier in noise with a heavy tail, its echo counts for little. */
static float clipped_white(gtm_monitor_line *line, float y)
{
    float size = fabsf(filled(y)), clip = line->noise.clip;
    line->outlier_age = (uint16_t)(line->outlier_age < 0xFFFFu ? line->outlier_age + 1u : 0xFFFFu);
    int is_gross = size > 8.0f && clip < 3.5f && line->outlier_age >= GTM_MONITOR_APART;
    int is_echo = !is_gross && line->outlier_age <= GTM_MONITOR_ECHO;
    line->sizes[line->sizes_at] = packed(size);
    line->sizes_at = next_of(line->sizes_at, GTM_MONITOR_LASTING);
    if (is_gross) {
        line->outlier_age = 0u;
    }
    if (is_echo) {
        clip = 1.0f;
    } else if (size > 8.0f && clip >= CLIPS[3]) {
        clip = 5.0f;
    }
    if (size > clip) {
        clip = lasting(line, clip, size);
    }
    return within(y, clip) * line->noise.scale;
}

/* What an open block tells, once it is complete. */
static void measured(const gtm_monitor_line *line, float *recent, float *late, float powers[2], float *burst)
{
    const gtm_monitor_open *open = &line->open;
    const unsigned part_rows = BLOCK / 5u;
    const float part = (float)part_rows;
    recent[COUNT] = open->count;
    recent[SIZE] = open->size;
    recent[FOURTH] = open->fourth;
    recent[SUM] = open->sum;
    for (unsigned i = 0u; i < 4u; i++) {
        recent[CLIPPED + i] = open->within_all + open->beyond[i];
    }
    for (unsigned i = 0u; i <= ORDER; i++) {
        recent[LAGS + i] = open->lags[i];
    }
    float squares = 0.0f, fourths = 0.0f, fast = 0.0f, before = line->burst;
    for (unsigned i = 0u; i < 5u; i++) {
        float sum = within(open->part_sums[i] / sqrtf(part), 6.0f), own = least(open->part_squares[i] / part, 4.0f) - 1.0f;
        squares += sum * sum / 5.0f;
        fourths += sum * sum * sum * sum / 5.0f;
        fast += own * before / 5.0f;
        before = own;
    }
    *burst = before;
    powers[0] = least(open->squares / (float)BLOCK, 4.0f) - 1.0f;
    powers[1] = least(squares, 4.0f) - 1.0f;
    float mean[2] = {0.0f, 0.0f};
    for (unsigned i = 0u; i < 4u; i++) {
        mean[0] += line->powers[i][0] / 4.0f;
        mean[1] += line->powers[i][1] / 4.0f;
    }
    late[SLOW] = powers[0] * mean[0];
    late[LOW] = powers[1] * mean[1];
    late[FAST] = fast;
    late[SQUARES] = squares;
    late[FOURTHS] = fourths;
    float sum = open->sum;
    for (unsigned i = 0u, have = 1u; i < 5u; i++) {
        for (; have < MEAN_BLOCKS[i]; have++) {
            sum += line->block_sums[have - 1u];
        }
        late[MEANS + i] = sum * sum / ((float)MEAN_BLOCKS[i] * (float)BLOCK);
    }
}

static void end_block(gtm_monitor_line *line, const float powers[2], float burst)
{
    for (unsigned i = 0u; i < 3u; i++) {
        line->powers[i][0] = line->powers[i + 1u][0];
        line->powers[i][1] = line->powers[i + 1u][1];
    }
    line->powers[3][0] = powers[0];
    line->powers[3][1] = powers[1];
    line->burst = burst;
    for (unsigned i = 14u; i > 0u; i--) {
        line->block_sums[i] = line->block_sums[i - 1u];
    }
    line->block_sums[0] = line->open.sum;
}

/* ---- the end of a block ---- */

/* The noise is learnt anew from here on: what is there has become the noise. */
static void begin_learning(gtm_monitor_line *line)
{
    memset(&line->blocks, 0, sizeof line->blocks);
    memset(line->there, 0, sizeof line->there);
    memset(line->in_window, 0, sizeof line->in_window);
    memset(line->window_sums, 0, sizeof line->window_sums);
    memset(line->window_squares, 0, sizeof line->window_squares);
    memset(line->sums, 0, sizeof line->sums);
    memset(line->squares, 0, sizeof line->squares);
    memset(line->bases, 0, sizeof line->bases);
    line->count = 0u;
    line->ring_at = 0u;
    line->there_at = 0u;
    line->phase = WAITING;
    line->passes = 0u;
    line->rows = 0u;
    line->taken = 0u;
    line->whole = 0u;
    line->learnt_rows = 0u;
    line->at = 0u;
    line->is_held = 0u;
    line->is_due = 0u;
    line->stages = 0u;
    end_nothing(line);
    open_block(line);
}

static void complete_block(gtm_monitor_line *line)
{
    if (line->is_held) {
        line->calm = (uint16_t)(line->suspected > 0u ? 0u : line->calm + 1u);
        line->held_for++;
        if (line->calm == 4u) {
            line->is_held = 0u;
            end_nothing(line);
        } else if (line->held_for == 240u) {
            begin_learning(line);
            return;
        }
        open_block(line);
        return;
    }
    if (line->suspected > 0u) {
        take_out(&line->blocks, (line->suspected + BLOCK - 1u) / BLOCK);
        line->is_due = 1u; /* the next calls' first: until then the noise is that of before */
        line->is_held = 1u;
        line->calm = 0u;
        line->held_for = 0u;
    } else {
        float recent[NAMES], late[ALL_LATE], powers[2], burst;
        measured(line, recent, late, powers, &burst);
        end_block(line, powers, burst);
        if (line->open.count >= 0.5f * (float)BLOCK) {
            remember(&line->blocks, recent, late);
            if (line->stages == STAGES) {
                line->noise = line->next;
            } else {
                learn_all(&line->blocks, 0u, &line->noise);
            }
        }
    }
    line->stages = 0u;
    open_block(line);
}

/* Take a row behind the calibrated filter; return what `put_sample` says of it. */
static int follow(gtm_monitor_line *line, unsigned j, float x, int is_silent)
{
    int said = -1;
    float y = behind_both(line, x), z = clipped_white(line, y);
    if (!line->is_held) {
        measure_size(line, x);
        measure_colour(line, x);
        measure_tail(line, y);
        measure_power(line, z);
    }
    unsigned is_there = isfinite(z) ? 1u : 0u;
    int32_t sample = is_there ? nearest(within(z, MOST) * SCALE) : 0;
    const int is_same = is_whole(line, is_there);
    if (!is_same) {
        put_row(line, is_there, sample);
    }
    if (is_there) {
        said = put_sample(line, j, sample);
    }
    suspect_row(line, is_same);
    line->row_in_block++; /* a complete block is closed with the next row: until then its noise is what rows are judged by */
    return is_silent ? -1 : said;
}

/* ---- learning the noise at first: passes over the rows that wait, a few rows a call ---- */

static float *waiting(gtm_monitor_line *line) { return line->store.waiting; }

/* Behind the calibrated filter; `mean` is that of the residual. */
static float behind_calibrated(gtm_monitor_line *line, unsigned j, float raw)
{
    line->raw_at = next_of(line->raw_at, WHITE_TAPS[j]);
    line->raw[line->raw_at] = raw;
    return dot(WHITENERS[j], line->raw, WHITE_TAPS[j], line->raw_at) - line->mean * WHITENER_SUMS[j];
}

static unsigned is_block_there(gtm_monitor_line *line, unsigned block)
{
    const float *rows = waiting(line) + (size_t)block * BLOCK;
    unsigned count = 0u;
    for (unsigned i = 0u; i < BLOCK; i++) {
        count += isfinite(rows[i]) ? 1u : 0u;
    }
    return 2u * count >= BLOCK ? 1u : 0u;
}

static void begin_pass(gtm_monitor_line *line, unsigned phase)
{
    line->phase = (uint8_t)phase;
    line->at = 0u;
    line->total = 0.0f;
    line->total_count = 0.0f;
    open_block(line);
}

/* Whether enough rows wait; where too many blocks lack most of their rows, the oldest is let go. */
static void wait_for_rows(gtm_monitor_line *line, float raw)
{
    waiting(line)[line->rows++] = raw;
    if (line->rows % BLOCK != 0u) {
        return;
    }
    unsigned block = line->rows / BLOCK - 1u;
    uint32_t is_there = is_block_there(line, block);
    line->whole |= is_there << block;
    line->taken = (uint16_t)(line->taken + is_there);
    if (line->taken == FIRST) {
        line->learnt_rows = line->rows;
        line->mean = 0.0f;
        line->spread = INFINITY;
        line->passes = 0u;
        begin_pass(line, CENTRING);
    } else if (block + 1u == GTM_MONITOR_FIRST_MOST) {
        line->taken = (uint16_t)(line->taken - (line->whole & 1u));
        line->whole >>= 1;
        line->rows = (uint16_t)(line->rows - BLOCK);
        memmove(waiting(line), waiting(line) + BLOCK, line->rows * sizeof(float));
    }
}

/* The mean without outliers: passes find, by turns, how far rows lie from the mean, and the mean of rows so near. */
static void centre(gtm_monitor_line *line)
{
    float away = waiting(line)[line->at] - line->mean;
    if (isfinite(away)) {
        line->total += line->passes % 2u == 0u ? within(away, 6.0f * line->spread) : least(fabsf(away), 6.0f * line->spread);
        line->total_count += 1.0f;
    }
    if (line->at + 1u < line->learnt_rows) {
        return;
    }
    float found = line->total / line->total_count;
    if (line->passes % 2u == 0u) {
        line->mean += found;
    } else {
        line->spread = found * 0.8453f;
    }
    line->passes++;
    begin_pass(line, line->passes < 7u ? CENTRING : CONVERTING);
    line->at = 0xFFFFu;
}

static void fill_blocks(gtm_monitor_line *line)
{
    line->row_in_block++;
    if (line->row_in_block == BLOCK) {
        float recent[NAMES], late[ALL_LATE], powers[2], burst;
        unsigned k = line->at / BLOCK;
        measured(line, recent, late, powers, &burst);
        end_block(line, powers, burst);
        /* tables hold the blocks in their order, each pass adding what it has learnt */
        for (unsigned i = 0u; i < NAMES; i++) {
            int is_own = line->phase == SIZING ? i <= SIZE : line->phase == COLOURING ? i >= LAGS : line->phase == TAILING
                ? (i == FOURTH || (i >= CLIPPED && i < LAGS)) : i == SUM;
            if (is_own) {
                line->blocks.recent[k][i] = packed(recent[i]);
            }
        }
        if (line->phase == WHITENING) {
            for (unsigned i = 0u; i < ALL_LATE; i++) {
                line->blocks.late[k % GTM_MONITOR_LATE][i] = packed(late[i]);
            }
        }
        open_block(line);
    }
}

static void end_pass(gtm_monitor_line *line)
{
    unsigned all = line->learnt_rows / BLOCK;
    unsigned count = all < SPAN ? all : SPAN;
    float sums[NAMES];
    line->blocks.recent_next = (uint16_t)(all % GTM_MONITOR_RECENT);
    line->blocks.recent_count = (uint16_t)all;
    add_recent(&line->blocks, 0u, count, COUNT, COUNT + 1u, sums);
    end_nothing(line);
    nothing(line->second, ORDER + 1u);
    if (line->phase == SIZING) {
        add_recent(&line->blocks, 0u, count, SIZE, SIZE + 1u, sums);
        learn_level(&line->noise, sums);
    } else if (line->phase == COLOURING) {
        add_recent(&line->blocks, 0u, count, LAGS, NAMES, sums);
        learn_colour(&line->noise, sums);
    } else if (line->phase == TAILING) {
        add_recent(&line->blocks, 0u, count, FOURTH, LAGS, sums);
        learn_tail(&line->noise, sums);
        line->outlier_age = 0xFFFFu;
        memset(line->sizes, 0, sizeof line->sizes);
    } else {
        /* blocks that lack most of their rows tell nothing */
        unsigned kept = 0u;
        for (unsigned k = 0u; k < all; k++) {
            if ((line->whole >> k) & 1u) {
                if (kept < k) {
                    memmove(line->blocks.recent[kept], line->blocks.recent[k], sizeof line->blocks.recent[0]);
                    memmove(line->blocks.late[kept], line->blocks.late[k % GTM_MONITOR_LATE], sizeof line->blocks.late[0]);
                }
                kept++;
            }
        }
        line->blocks.recent_count = line->blocks.recent_next = (uint16_t)kept;
        line->blocks.late_count = line->blocks.late_next = (uint16_t)kept;
        line->is_due = 1u;
        line->outlier_age = 0xFFFFu;
        memset(line->sizes, 0, sizeof line->sizes);
    }
    begin_pass(line, line->phase + 1u);
}

/* One row of the pass that is under way. */
static void pass_row(gtm_monitor_line *line, unsigned j)
{
    float *row = waiting(line) + line->at;
    float x = *row;
    switch (line->phase) {
    case CENTRING:
        centre(line);
        break;
    case CONVERTING:
        *row = behind_calibrated(line, j, x);
        if (isfinite(*row)) {
            line->total += least(fabsf(*row), 30.0f);
            line->total_count += 1.0f;
        }
        break;
    case SIZING:
        measure_size(line, x);
        fill_blocks(line);
        break;
    case COLOURING:
        measure_colour(line, x);
        fill_blocks(line);
        break;
    case TAILING:
        measure_tail(line, behind_both(line, x));
        fill_blocks(line);
        break;
    default:
        measure_power(line, clipped_white(line, behind_both(line, x)));
        fill_blocks(line);
        break;
    }
    line->at++;
    if (line->at < line->learnt_rows || line->phase == CENTRING) {
        return;
    }
    if (line->phase == CONVERTING) {
        line->typical = largest(1.2533f * line->total / largest(line->total_count, 1.0f), LEAST);
        end_nothing(line);
        begin_pass(line, SIZING);
    } else {
        end_pass(line);
    }
}

/* Take what was said of a row; return 1 where that is an alarm: a rise after it had come down. */
static uint32_t hear(gtm_monitor_line *line, int said)
{
    uint32_t rose = 0u;
    if (said == 0) {
        line->is_low = 1u;
        line->is_above = 0u;
        line->came_down = 1u;
    } else if (said == 1) {
        rose = line->is_low;
        line->is_low = 0u;
        line->is_above = 1u;
    }
    return rose;
}

/* Take the next row of the residual; return 1 where a row that this lets be judged is an alarm. */
static uint32_t take_residual(gtm_monitor_line *line, unsigned j, float raw, unsigned *may_learn)
{
    uint32_t rose = 0u;
    if (line->phase == FOLLOWING && line->row_in_block == BLOCK) {
        complete_block(line);
    }
    learn_due(line, may_learn);
    if (line->phase == FOLLOWING && line->rows == 0u) {
        return hear(line, follow(line, j, behind_calibrated(line, j, raw), 0));
    }
    if (line->phase == WAITING) {
        wait_for_rows(line, raw);
        return 0u;
    }
    if (line->rows == GTM_MONITOR_WAITING) { /* can't be: there is room for all rows that learning takes */
        begin_learning(line);
        return 0u;
    }
    waiting(line)[line->rows++] = raw;
    const unsigned phase = line->phase;
    if (phase == FOLLOWING && line->is_due) {
        return 0u; /* the noise isn't learnt yet */
    }
    for (unsigned k = 0u; k < ROWS_A_CALL[phase] && line->phase == phase; k++) {
        if (phase != FOLLOWING) {
            pass_row(line, j);
            continue;
        }
        float x = waiting(line)[line->at];
        int is_silent = line->at < line->learnt_rows ? 1 : 0;
        line->at++;
        rose |= hear(line, follow(line, j, is_silent ? x : behind_calibrated(line, j, x), is_silent));
        if (line->at == line->rows) {
            line->rows = 0u; /* all that waited has been judged */
            break;
        }
        if (line->row_in_block == BLOCK) {
            complete_block(line);
        }
    }
    return rose;
}

/* ---- samples in, events out ---- */

/* The difference of two angles in deg, the short way round. */
static float step_of(float before, float after)
{
    float step = after - before;
    if (fabsf(step) > 180.0f) {
        step -= 360.0f * roundf(step / 360.0f);
    }
    return step;
}

static float slope_of(const gtm_monitor_state *state, unsigned channel)
{
    return step_of(state->before[channel], state->latest[channel]) * (0.5f / PERIOD_S);
}

/* Channels that are missing while others live: more than half a second of the last two. */
static void count_missing(gtm_monitor_state *state, uint32_t lost)
{
    if (lost == (1u << GTM_MONITOR_CHANNELS) - 1u) {
        return; /* nothing was recorded: that says nothing of any sensor */
    }
    uint32_t old = state->lost[state->lost_at];
    state->lost[state->lost_at] = ({{ lost_type }})lost;
    state->lost_at = next_of(state->lost_at, GTM_MONITOR_LOST);
    if (lost == old) {
        return;
    }
    for (unsigned c = 0u; c < GTM_MONITOR_CHANNELS; c++) {
        uint32_t bit = 1u << c;
        state->lost_counts[c] = (uint16_t)(state->lost_counts[c] + ((lost & bit) ? 1u : 0u) - ((old & bit) ? 1u : 0u));
        if (state->lost_counts[c] > GTM_MONITOR_LOST / 4u) {
            state->missing |= bit;
        } else if (state->lost_counts[c] <= GTM_MONITOR_LOST / 20u) {
            state->missing &= ~bit;
        }
    }
}

static void take_row(gtm_monitor_state *state, const float *values, gtm_monitor_events *events)
{
    float derived[GTM_MONITOR_DERIVED + 1];
    uint32_t lost = 0u;
    for (unsigned c = 0u; c < GTM_MONITOR_CHANNELS; c++) {
        state->before[c] = state->middle[c];
        state->middle[c] = state->latest[c];
        state->latest[c] = isfinite(values[c]) ? within(values[c], 1e9f) : NAN;
        lost |= isfinite(values[c]) ? 0u : 1u << c;
    }
    count_missing(state, lost);
    derive(state, derived);
    unsigned may_learn = 1u;
    for (unsigned j = 0u; j < GTM_MONITOR_RESIDUALS; j++) {
        gtm_monitor_line *line = &state->lines[j];
        float predicted = OFFSETS[j];
        line->input_at = next_of(line->input_at, TAPS[j]);
        for (unsigned i = 0u; i < INPUT_COUNTS[j]; i++) {
            unsigned from = INPUTS[j][i];
            const float *channels = IS_LATE[j] ? state->middle : state->latest;
            line->inputs[i][line->input_at] = from < GTM_MONITOR_CHANNELS ? channels[from] : derived[from - GTM_MONITOR_CHANNELS];
            predicted += dot(MARKOV[j] + (size_t)i * 2u * TAPS[j], line->inputs[i], TAPS[j], line->input_at);
        }
        line->read_at = next_of(line->read_at, READS[j]);
        line->reads[line->read_at] = OUTPUTS[j] < GTM_MONITOR_CHANNELS ? state->latest[OUTPUTS[j]] : derived[OUTPUTS[j] - GTM_MONITOR_CHANNELS];
        float read = line->reads[next_of(line->read_at, READS[j])]; /* the oldest */
        line->predicted = isfinite(predicted) ? predicted : NAN;
        line->residual = read - line->predicted;
        if (state->first_rows < AHEAD[j]) {
            continue; /* the first sample's residual isn't known yet */
        }
        events->alarms |= take_residual(line, j, line->residual, &may_learn) << j;
    }
    state->first_rows = (uint16_t)(state->first_rows < 0xFFFFu ? state->first_rows + 1u : 0xFFFFu);
}

void gtm_monitor_init(gtm_monitor_state *state)
{
    memset(state, 0, sizeof *state);
    nothing(state->before, GTM_MONITOR_CHANNELS);
    nothing(state->middle, GTM_MONITOR_CHANNELS);
    nothing(state->latest, GTM_MONITOR_CHANNELS);
    for (unsigned j = 0u; j < GTM_MONITOR_RESIDUALS; j++) {
        gtm_monitor_line *line = &state->lines[j];
        for (unsigned i = 0u; i < GTM_MONITOR_INPUTS_MOST; i++) {
            nothing(line->inputs[i], GTM_MONITOR_TAPS_MOST);
        }
        nothing(line->reads, GTM_MONITOR_READS_MOST);
        nothing(line->raw, GTM_MONITOR_WHITE_MOST);
        nothing(line->second, ORDER + 1u);
        line->predicted = line->residual = NAN;
        line->outlier_age = 0xFFFFu;
        begin_learning(line);
    }
}

void gtm_monitor_reset(gtm_monitor_state *state) { gtm_monitor_init(state); }

static void tell(gtm_monitor_state *state, gtm_monitor_events *events)
{
    state->alarmed |= events->alarms;
    events->missing = state->missing;
    events->possible = 0xFFFFFFFFu;
    for (unsigned j = 0u; j < GTM_MONITOR_RESIDUALS; j++) {
        const gtm_monitor_line *line = &state->lines[j];
        uint32_t waits = line->phase == FOLLOWING ? line->rows - (line->rows ? line->at : 0u) : line->rows;
        events->flags |= line->phase == FOLLOWING ? 0u : GTM_MONITOR_LEARNING;
        events->backlog_rows = (uint16_t)(waits > events->backlog_rows ? waits : events->backlog_rows);
        events->above |= line->is_above ? 1u << j : 0u;
        if ((line->is_above && line->came_down) || ((events->alarms >> j) & 1u)) {
            events->possible &= AFFECTED_BY[j];
            events->involved |= AFFECTED_BY[j];
        }
    }
    events->possible &= events->involved;
}

gtm_monitor_events gtm_monitor_update(gtm_monitor_state *state, const gtm_monitor_sample *sample, uint64_t time_us)
{
    gtm_monitor_events events;
    float values[GTM_MONITOR_CHANNELS], none[GTM_MONITOR_CHANNELS];
    memset(&events, 0, sizeof events);
    memcpy(values, sample, sizeof values);
    if (state->has_begun) {
        /* rows are counted from sample to sample, so a clock that is a little off adds up to nothing */
        const uint64_t longest = (GTM_MONITOR_MISSING_MOST + 1u) * (uint64_t)GTM_MONITOR_PERIOD_US;
        uint64_t passed = time_us > state->time_us ? time_us - state->time_us : 0u;
        uint32_t rows = passed < longest ? ((uint32_t)passed + GTM_MONITOR_PERIOD_US / 2u) / GTM_MONITOR_PERIOD_US : 0u;
        if (rows == 0u && passed == 0u && state->time_us - time_us > longest) {
            passed = longest; /* time has run backwards, and far */
        }
        if (rows == 0u && passed < longest) {
            events.flags |= GTM_MONITOR_IGNORED;
            tell(state, &events);
            return events;
        }
        if (passed >= longest) {
            gtm_monitor_reset(state);
            events.flags |= GTM_MONITOR_RESTARTED;
        } else {
            nothing(none, GTM_MONITOR_CHANNELS);
            for (uint32_t k = 1u; k < rows; k++) {
                take_row(state, none, &events);
            }
            uint64_t due = state->time_us + rows * (uint64_t)GTM_MONITOR_PERIOD_US;
            state->time_us = time_us >= due ? due + (time_us - due) / 8u : due - (due - time_us) / 8u;
        }
    }
    if (!state->has_begun) {
        state->has_begun = 1u;
        state->time_us = time_us;
    }
    take_row(state, values, &events);
    tell(state, &events);
    return events;
}

float gtm_monitor_predicted(const gtm_monitor_state *state, unsigned residual)
{
    return residual < GTM_MONITOR_RESIDUALS ? state->lines[residual].predicted : NAN;
}

float gtm_monitor_residual(const gtm_monitor_state *state, unsigned residual)
{
    return residual < GTM_MONITOR_RESIDUALS ? state->lines[residual].residual : NAN;
}

float gtm_monitor_noise_level(const gtm_monitor_state *state, unsigned residual)
{
    if (residual >= GTM_MONITOR_RESIDUALS || state->lines[residual].phase != FOLLOWING) {
        return NAN;
    }
    return state->lines[residual].noise.local;
}

float gtm_monitor_statistic(const gtm_monitor_state *state, unsigned residual, unsigned window, unsigned is_energy)
{
    float base;
    if (residual >= GTM_MONITOR_RESIDUALS || window >= GTM_MONITOR_WINDOWS || state->lines[residual].phase != FOLLOWING) {
        return NAN;
    }
    const gtm_monitor_line *line = &state->lines[residual];
    const float *test = TESTS[residual] + (size_t)window * ALL_TESTS, *tolerance = TOLERANCES[residual];
    uint32_t length = baseline_of(line, window, &base);
    if (length == 0u) {
        return NAN;
    }
    window_state own = window_of(&line->noise, test, WINDOW_ROWS[window], line->sums[window], line->squares[window], base, length);
    if (is_energy) {
        return nats_of_energy(&line->noise, &own, tolerance) / test[ENOUGH + 1];
    }
    return nats_of_mean(&line->noise, &own, square_of_shift(&own, tolerance)) / test[ENOUGH];
}
