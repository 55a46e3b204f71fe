/* A particle filter over the third and the fifth plant (joint_oracle.py says what it knows).

   A particle is a whole plant: its temperatures, its control unit, what disturbs it, and whether
   something is touched, which, and since when. Nothing is linearised: each lives through the steps
   of the plant with noise of its own, is weighed by what was read, and copied by its weight
   (Gordon, Salmond and Smith, IEE Proceedings F 140, 1993). What a particle touched in the last
   five seconds stays with it; so what is said of a moment rests on the readings up to five seconds
   later. Rows of `state` are quantities, columns particles. */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef float real;

enum { TOUCH = 8, KEPT = 126, STEPS_KNOWN_BEFORE = 30 };
enum { THIRD, FIFTH };

/* as `Problem` of joint_oracle.py */
typedef struct {
    int particles, steps, readings, events, ages, bins, pad_count, plant, seed, slot;
    real first_share, celsius_sd, permille_sd;
    const real *aim, *air;              /* by step: setting (0: off), room */
    const uint8_t *blocked, *reset;     /* by step: nothing begins; the clock begins anew */
    const int *first, *second;          /* by reading: the two steps in which it may have been */
    const real *celsius, *permille;     /* by reading */
    const int *celsius_at, *permille_at; /* by tick of the fifth plant: whose value is shown */
    const int16_t *touch_of;            /* [events][ages]: the touch after so many steps, or -1 */
    const real *touches;                /* W/K, J/K, W/K, C, W of wire from step to step, s */
    const uint8_t *kind_of, *is_drag;   /* of an event: 0 joint, 1 wipe, 2 touch */
    const int *pads;                    /* touches to which a drag moves */
    const real *begins, *ends;          /* hazards in two steps: [what was before][bin], [kind][bin] */
    const real *constants;
    real *contact, *start, *end;        /* by slot: probability, expected starts and ends */
    real *foretold_c, *foretold_p;      /* by reading: the mean of the particles, before it is known */
} Problem;

enum {
    HEATER, BODY, TIP, SHANK, JUNCTION, FELT, SLOPE, POSITION, OWED, FIRED, DRAW, TRIM, RAMP,
    SHOWN, SHOWN_BEFORE, MEAN, MEAN_BEFORE, SUM, WATTS, TOLD_C, TOLD_P,
    WANDER, LINE, LINE_FAST, HAND, SAG, GUST,
    WORK, WET, CONDUCTANCE, CAPACITY, LEAK, WIRE, WIRE_FROM, WIRE_TO, WETS, REALS
};
enum { CLOCK, INSIDE, BEFORE, EVENT, NOW, MOVED, INTS };

#define EACH for (int i = 0; i < n; i++)
#define ROW(k) (state + (size_t)(k) * n)
#define FLAGS(k) (flags + (size_t)(k) * n)

static inline uint32_t drawn(uint32_t *s)
{
    uint32_t x = *s;
    x ^= x << 13, x ^= x >> 17, x ^= x << 5;
    return *s = x;
}

static inline real uniform(uint32_t *s) { return (drawn(s) >> 8) * (1.0f / 16777216.0f); }

/* the sum of four uniform values: normal enough within three standard deviations */
static inline real normal(uint32_t *s)
{
    uint32_t a = drawn(s), b = drawn(s);
    real sum = (real)(a & 0xffff) + (real)(a >> 16) + (real)(b & 0xffff) + (real)(b >> 16);
    return (sum - 131070.0f) * (1.7320508f / 65536.0f);
}

static inline real within(real x, real low, real high) { return x < low ? low : x > high ? high : x; }

static inline real fourth_power(real x) { return x * x * x * x; }

/* -- what is touched ---------------------------------------------------------------------------- */

static void touch(const Problem *p, real *state, int i, int now, int clock, int was)
{
    int n = p->particles;
    if (now < 0) {
        ROW(CONDUCTANCE)[i] = ROW(LEAK)[i] = ROW(WIRE)[i] = 0;
        ROW(CAPACITY)[i] = 1;
        return;
    }
    const real *one = p->touches + (size_t)now * TOUCH;
    ROW(CONDUCTANCE)[i] = one[0], ROW(CAPACITY)[i] = one[1], ROW(LEAK)[i] = one[2];
    ROW(WORK)[i] = one[3], ROW(WIRE)[i] = one[4], ROW(WETS)[i] = one[7];
    ROW(WIRE_FROM)[i] = clock + one[5], ROW(WIRE_TO)[i] = clock + one[6];
    if (was < 0)
        ROW(WET)[i] = p->plant == FIFTH ? 0.35f : 0.0f;
}

/* A drag moves to another pad 0.25 s after the last or later; which, and when, is drawn. */
static int touched_now(const Problem *p, int *flags, uint32_t *random, int i)
{
    int n = p->particles, event = FLAGS(EVENT)[i], clock = FLAGS(CLOCK)[i];
    if (p->is_drag[event] && clock > 0) {
        int moves = clock - FLAGS(MOVED)[i] >= 25 && uniform(random + i) < 0.1f;
        return moves ? p->pads[drawn(random + i) % p->pad_count] : FLAGS(NOW)[i];
    }
    return p->touch_of[(size_t)event * p->ages + (clock < p->ages ? clock : p->ages - 1)];
}

static void contacts(const Problem *p, real *state, int *flags, uint32_t *random, real *weight, int step)
{
    int n = p->particles;
    EACH {
        int *clock = FLAGS(CLOCK) + i, *inside = FLAGS(INSIDE) + i, *before = FLAGS(BEFORE) + i;
        if (p->reset[step]) { /* a tool in its stand touches nothing, nor does a new setting find it at work */
            weight[i] *= *inside ? 1e-6f : 1.0f;
            *inside = *clock = 0, *before = 2;
        }
        *clock += 2;
        int bin = *clock / 2 < p->bins ? *clock / 2 : p->bins - 1;
        if (*inside) {
            int kind = p->kind_of[FLAGS(EVENT)[i]];
            if (uniform(random + i) < p->ends[kind * p->bins + bin])
                *inside = *clock = 0, *before = kind ? 1 : 0;
        } else if (!p->blocked[step] && uniform(random + i) < p->begins[*before * p->bins + bin]) {
            *inside = 1, *clock = 0;
            FLAGS(EVENT)[i] = drawn(random + i) % p->events;
        }
        int now = *inside ? touched_now(p, flags, random, i) : -1;
        if (now != FLAGS(NOW)[i]) {
            touch(p, state, i, now, *clock, FLAGS(NOW)[i]);
            FLAGS(MOVED)[i] = *clock, FLAGS(NOW)[i] = now;
        }
    }
}

/* -- the third plant ---------------------------------------------------------------------------- */

/* as third_plant.Plants, in its order */
enum {
    T_RATED, T_HEATER, T_COPPER, T_BETWEEN, T_BARREL, T_TO_BARREL, T_FROM_BARREL, T_CONVECTION,
    T_RADIATING, T_NEAR, T_FORWARD, T_BAND, T_LEAD, T_DEAD, T_LAG, T_SEES, T_NOISE, T_WINDOW, T_LATE,
    T_WETTING
};
static const real DT = 0.01f;

static void third(const Problem *p, real *state, int *flags, uint32_t *random, real *ring, real *decided, int step)
{
    int n = p->particles, odd = step & 1;
    const real *c = p->constants;
    int deep = (int)c[T_DEAD] + 1, window = (int)c[T_WINDOW], late = (int)c[T_LATE], size = window + late + 1;
    real aim = p->aim[step], is_on = aim > 23.0f ? 1.0f : 0.0f, cold = fourth_power(296.15f);
    real by_barrel = c[T_TO_BARREL] * c[T_FROM_BARREL] / (c[T_TO_BARREL] + c[T_FROM_BARREL]);
    real holds = (c[T_CONVECTION] + by_barrel) * (aim - 23.0f) + c[T_RADIATING] * (fourth_power(aim + 273.15f) - cold);
    real holding = c[T_FORWARD] * holds / c[T_RATED];
    real *heater = ROW(HEATER), *copper = ROW(TIP), *barrel = ROW(SHANK), *felt = ROW(FELT), *slope = ROW(SLOPE);
    real *position = ROW(POSITION), *owed = ROW(OWED), *fired = ROW(FIRED), *work = ROW(WORK), *wet = ROW(WET);
    real *conductance = ROW(CONDUCTANCE), *capacity = ROW(CAPACITY), *leak = ROW(LEAK), *wire = ROW(WIRE);
    real *wire_from = ROW(WIRE_FROM), *wire_to = ROW(WIRE_TO), *draught = ROW(WANDER), *line = ROW(LINE), *jumps = ROW(LINE_FAST);
    int *clock = FLAGS(CLOCK), *inside = FLAGS(INSIDE), *before = FLAGS(BEFORE), *touched = FLAGS(NOW);
    if (step % 10 == 0) /* Ornstein-Uhlenbeck of 15, 30 and 6 s, each 0.1 s; jumps of the mains as the last of them */
        EACH {
            draught[i] = draught[i] * 0.99335f + 0.12f * 0.11510f * normal(random + i);
            line[i] = line[i] * 0.99667f + 0.015f * 0.08151f * normal(random + i);
            jumps[i] = jumps[i] * 0.98347f + 0.004f * 0.18107f * normal(random + i);
        }
    real *decides = decided + (size_t)(step % deep) * n, *acts = decided + (size_t)((step + 1) % deep) * n;
    real *sum = ring + (size_t)(step % size) * n;
    EACH {
        real error = aim - (felt[i] + 0.05f * normal(random + i) + c[T_LEAD] * slope[i]);
        real side = error > c[T_BAND] ? 1.0f : error < -c[T_BAND] ? -1.0f : position[i];
        position[i] = side = side * error < 0 ? 0.0f : side;
        decides[i] = (side > 0 ? 1.0f : side < 0 ? 0.0f : holding) * is_on;
        real due = owed[i] + acts[i], fires = due >= 1.0f ? 1.0f : 0.0f;
        owed[i] = due - fires;
        fired[i] += fires;
        sum[i] = fired[i];
        real touches = touched[i] >= 0 ? 1.0f : 0.0f, age = (real)(clock[i] + odd);
        wet[i] = touches * (wet[i] + DT * (1 - wet[i]) / c[T_WETTING]);
        real into_work = conductance[i] * (0.25f + 0.75f * wet[i]) * (copper[i] - work[i]);
        real melting = (age >= wire_from[i]) & (age < wire_to[i]) ? wire[i] * touches : 0.0f;
        real near = inside[i] | ((clock[i] < STEPS_KNOWN_BEFORE) & (before[i] < 2)) ? c[T_NEAR] : 1.0f;
        real lost = c[T_CONVECTION] * (1 + draught[i]) * near * (copper[i] - 23.0f) + c[T_RADIATING] * (fourth_power(copper[i] + 273.15f) - cold);
        real across = c[T_BETWEEN] * (heater[i] - copper[i]), to_barrel = c[T_TO_BARREL] * (heater[i] - barrel[i]);
        real volts = 1 + line[i] + jumps[i];
        heater[i] += DT * (c[T_RATED] * fires * volts * volts - across - to_barrel) / c[T_HEATER];
        copper[i] += DT * (across - into_work - melting - lost) / c[T_COPPER];
        barrel[i] += DT * (to_barrel - c[T_FROM_BARREL] * (barrel[i] - 23.0f)) / c[T_BARREL];
        work[i] += DT * (into_work - leak[i] * (work[i] - 35.0f)) / capacity[i];
        real rate = (c[T_SEES] * copper[i] + (1 - c[T_SEES]) * heater[i] - felt[i]) / c[T_LAG];
        felt[i] += DT * rate;
        slope[i] += DT * (rate - slope[i]) / 0.04f;
    }
    real *until = ring + (size_t)((step - late + 1000 * size) % size) * n;
    real *from = ring + (size_t)((step - late - window + 1000 * size) % size) * n;
    EACH {
        ROW(TOLD_P)[i] = (until[i] - from[i]) * 1000.0f / window;
        ROW(TOLD_C)[i] = felt[i];
    }
}

/* -- the fifth plant ---------------------------------------------------------------------------- */

/* as fifth_plant.Plants, in its order, and what its control unit and its display make of them */
enum {
    F_RATED, F_HEATER, F_BODY, F_END, F_SHANK, F_INNER, F_OUTER, F_OF_BODY, F_OF_END, F_TO_SHANK,
    F_TO_HANDLE, F_ROOM, F_DRIFT, F_NEAR_HEATER, F_JUNCTION, F_NOISE, F_FILTER, F_CAPACITY_OFF,
    F_TABLE_OFF, F_BACK, F_TRIM, F_SHARE, F_OBSERVER, F_DEAD, F_RISE_S, F_FALL_S, F_MEAN, F_POWER_EVERY,
    F_SHOWN, F_SHOWN_EVERY, F_PHASE, F_CAPACITY, F_HOLDING, F_FILTERING, F_OBSERVING, F_RISE, F_FALL,
    F_TRIMMING, F_JUNCTION_STEP, F_KEPT, F_WINDOW
};

static void disturb_fifth(const Problem *p, real *state, uint32_t *random)
{
    int n = p->particles;
    real *line = ROW(LINE), *air = ROW(WANDER), *sag = ROW(SAG), *gust = ROW(GUST);
    EACH { /* 40 s, 4 s; spells each 45 and 60 s that last 5 and 7 s */
        line[i] = line[i] * 0.997503f + 0.015f * 0.070622f * normal(random + i);
        air[i] = air[i] * 0.97531f + 0.06f * 0.22085f * normal(random + i);
        if (uniform(random + i) < (sag[i] == 0 ? 0.1f / 45 : 0.1f / 5.25f))
            sag[i] = sag[i] == 0 ? 0.01f + 0.04f * uniform(random + i) : 0.0f;
        if (uniform(random + i) < (gust[i] == 0 ? 0.1f / 60 : 0.1f / 7.0f))
            gust[i] = gust[i] == 0 ? 0.2f + 0.4f * uniform(random + i) : 0.0f;
    }
}

static void decide_fifth(const Problem *p, real *state, uint32_t *random, real *ring, int step)
{
    int n = p->particles, tick = step / 2;
    const real *c = p->constants;
    real aim = p->aim[step];
    real *felt = ROW(FELT), *draw = ROW(DRAW), *trim = ROW(TRIM), *ramp = ROW(RAMP), *shown = ROW(SHOWN), *mean = ROW(MEAN);
    real *hand = ROW(HAND), *oldest = ring + (size_t)(tick % (int)c[F_WINDOW]) * n;
    EACH {
        hand[i] = hand[i] * 0.935507f + 0.10f * 0.353298f * normal(random + i);
        real read = ROW(JUNCTION)[i] + c[F_NOISE] * normal(random + i);
        real now = felt[i] + c[F_FILTERING] * (read - felt[i]), rate = (now - felt[i]) / 0.02f;
        felt[i] = now;
        draw[i] += c[F_OBSERVING] * (ramp[i] - c[F_CAPACITY] * rate - c[F_HOLDING] * (now - 25.0f) - trim[i] - draw[i]);
        real off = aim - now, beyond = fabsf(off) - c[F_DEAD];
        off = beyond > 0 ? copysignf(beyond, off) : 0.0f;
        trim[i] = within(trim[i] + (fabsf(off) < 8 ? c[F_TRIMMING] * off : 0.0f), -0.1f, 0.1f);
        real asked = c[F_HOLDING] * (aim - 25.0f) + c[F_CAPACITY] / c[F_BACK] * off + c[F_SHARE] * (draw[i] > 0 ? draw[i] : 0.0f) + trim[i];
        asked = within(aim > 0 ? asked : 0.0f, 0.0f, 1.0f);
        ramp[i] += within(asked - ramp[i], -c[F_FALL], c[F_RISE]);
        real command = rintf(ramp[i] * 64) / 64;
        real volts = within(1 + ROW(LINE)[i] - ROW(SAG)[i], 0.9f, 1.1f);
        ROW(WATTS)[i] = command * c[F_RATED] * volts * volts;
        ROW(SHOWN_BEFORE)[i] = shown[i], ROW(MEAN_BEFORE)[i] = mean[i];
        shown[i] = (1 - c[F_KEPT]) * now + c[F_KEPT] * shown[i];
        ROW(SUM)[i] += command - oldest[i];
        oldest[i] = command;
        mean[i] = 1000.0f * ROW(SUM)[i] / c[F_WINDOW];
    }
    int of_c = p->celsius_at[tick], of_p = p->permille_at[tick];
    if (tick == 0 || of_c != p->celsius_at[tick - 1])
        memcpy(ROW(TOLD_C), of_c == tick ? shown : ROW(SHOWN_BEFORE), n * sizeof(real));
    if (tick == 0 || of_p != p->permille_at[tick - 1])
        memcpy(ROW(TOLD_P), of_p == tick ? mean : ROW(MEAN_BEFORE), n * sizeof(real));
}

static void fifth(const Problem *p, real *state, int *flags, uint32_t *random, real *ring, int step)
{
    int n = p->particles, odd = step & 1;
    const real *c = p->constants;
    if (step % 10 == 0)
        disturb_fifth(p, state, random);
    if (!odd)
        decide_fifth(p, state, random, ring, step);
    real air = p->air[step];
    real *heater = ROW(HEATER), *body = ROW(BODY), *end = ROW(TIP), *shank = ROW(SHANK), *junction = ROW(JUNCTION);
    real *work = ROW(WORK), *wet = ROW(WET), *conductance = ROW(CONDUCTANCE), *capacity = ROW(CAPACITY), *leak = ROW(LEAK);
    real *wire = ROW(WIRE), *wire_from = ROW(WIRE_FROM), *wire_to = ROW(WIRE_TO), *wets = ROW(WETS), *watts = ROW(WATTS);
    real *wander = ROW(WANDER), *gusts = ROW(GUST), *hand = ROW(HAND);
    int *clock = FLAGS(CLOCK);
    EACH {
        real gust = 1 + wander[i] + gusts[i], grip = 1 + within(hand[i], -0.5f, 0.5f), age = (real)(clock[i] + odd);
        gust = gust < 0.5f ? 0.5f : gust;
        wet[i] += (1 - wet[i]) * DT / (wets[i] < DT ? DT : wets[i]);
        real melting = (age >= wire_from[i]) & (age < wire_to[i]) ? wire[i] : 0.0f;
        real into_body = c[F_INNER] * (heater[i] - body[i]), into_end = c[F_OUTER] * (body[i] - end[i]);
        real into_shank = c[F_TO_SHANK] * (body[i] - shank[i]), body_over = body[i] - air, end_over = end[i] - air;
        real from_body = c[F_OF_BODY] * gust * body_over * (0.8f + 0.0007f * body_over);
        real from_end = c[F_OF_END] * gust * end_over * (0.8f + 0.0007f * end_over);
        real into_work = conductance[i] * wet[i] * grip * (end[i] - work[i]);
        real into_board = conductance[i] > 0 ? leak[i] * (work[i] - 28.0f) : 0.0f;
        heater[i] += DT / c[F_HEATER] * (watts[i] - into_body);
        body[i] += DT / c[F_BODY] * (into_body - into_end - into_shank - from_body);
        end[i] += DT / c[F_END] * (into_end - from_end - into_work - 0.5f * melting);
        shank[i] += DT / c[F_SHANK] * (into_shank - c[F_TO_HANDLE] * (shank[i] - air));
        work[i] += DT * (into_work - into_board - 0.5f * melting) / capacity[i];
        junction[i] += c[F_JUNCTION_STEP] * (c[F_NEAR_HEATER] * heater[i] + (1 - c[F_NEAR_HEATER]) * body[i] - junction[i]);
    }
}

/* -- the filter --------------------------------------------------------------------------------- */

static void weigh(const Problem *p, const real *celsius, const real *permille, int reading, real share, real *likely)
{
    int n = p->particles;
    real scale = 0.70710678f / p->celsius_sd;
    EACH {
        real off = p->celsius[reading] - celsius[i];
        real rounded = 0.5f * (erff((off + 0.5f) * scale) - erff((off - 0.5f) * scale)) + 1e-5f;
        real z = (p->permille[reading] - permille[i]) / p->permille_sd;
        real power = expf(-0.5f * z * z) + 1e-3f * expf(-0.02f * z * z);
        likely[i] += share * rounded * power;
    }
}

/* The sums of weights of particles that touch, begin and end, at the slot so many ago. */
static void tell(const Problem *p, const uint64_t *recent, const uint64_t *older, const real *weight, int ago, int slot)
{
    int n = p->particles;
    real contact = 0, start = 0, end = 0, all = 0;
    EACH {
        int now = (ago < 64 ? recent[i] >> ago : older[i] >> (ago - 64)) & 1;
        int was = (ago + 1 < 64 ? recent[i] >> (ago + 1) : older[i] >> (ago - 63)) & 1;
        contact += weight[i] * now, start += weight[i] * (now & !was), end += weight[i] * (was & !now), all += weight[i];
    }
    p->contact[slot] = contact / all, p->start[slot] = start / all, p->end[slot] = end / all;
}

/* Systematic resampling: which particle each of the next ones is a copy of. */
static void resampled(int n, const real *weight, uint32_t *random, int *of)
{
    double begin = uniform(random) / n, total = weight[0];
    int from = 0;
    EACH {
        while (total < begin + (double)i / n && from < n - 1)
            total += weight[++from];
        of[i] = from;
    }
}

static void copy(void *rows, void *spare, const int *of, int count, int n, int size)
{
    for (int k = 0; k < count; k++) {
        char *row = (char *)rows + (size_t)k * n * size;
        if (size == 4)
            EACH ((uint32_t *)spare)[i] = ((uint32_t *)row)[of[i]];
        else
            EACH ((uint64_t *)spare)[i] = ((uint64_t *)row)[of[i]];
        memcpy(row, spare, (size_t)n * size);
    }
}

/* Copies part: the size of the load is not the same in all of them. */
static void spread(int n, real *state, uint32_t *random)
{
    EACH {
        real width = uniform(random + i) < 0.1f ? 0.2f : 0.04f;
        real of_contact = expf(width * normal(random + i)), of_heat = expf(width * normal(random + i));
        ROW(CONDUCTANCE)[i] *= of_contact;
        ROW(WIRE)[i] *= of_heat;
        if (ROW(CONDUCTANCE)[i] > 0)
            ROW(CAPACITY)[i] *= of_heat;
    }
}

static void begin(const Problem *p, real *state, int *flags, uint32_t *random, real hot_c, real shank_c)
{
    int n = p->particles;
    uint32_t seed = 2463534242u ^ (uint32_t)p->seed * 2654435761u;
    EACH {
        random[i] = (seed | 1) * 747796405u + 2891336453u + (uint32_t)i * 2654435769u;
        random[i] += !random[i];
        for (int k = 0; k < 16; k++)
            drawn(random + i);
        ROW(HEATER)[i] = ROW(BODY)[i] = ROW(TIP)[i] = ROW(JUNCTION)[i] = ROW(FELT)[i] = hot_c;
        ROW(SHOWN)[i] = ROW(SHOWN_BEFORE)[i] = ROW(TOLD_C)[i] = hot_c;
        ROW(SHANK)[i] = shank_c, ROW(CAPACITY)[i] = ROW(WETS)[i] = 1;
        ROW(WANDER)[i] = (p->plant == FIFTH ? 0.06f : 0.12f) * normal(random + i);
        ROW(LINE)[i] = 0.015f * normal(random + i);
        FLAGS(NOW)[i] = -1, FLAGS(BEFORE)[i] = 3;
    }
}

/* `from` is the step at which the record begins. Returns 0, or 1 where there is no memory. */
int find(const Problem *p, int from, real hot_c, real shank_c)
{
    int n = p->particles;
    const real *c = p->constants;
    int size = p->plant == FIFTH ? (int)c[F_WINDOW] : (int)(c[T_WINDOW] + c[T_LATE]) + 1;
    int deep = p->plant == FIFTH ? 1 : (int)c[T_DEAD] + 1;
    real *state = calloc((size_t)REALS * n, sizeof(real)), *ring = calloc((size_t)size * n, sizeof(real));
    real *decided = calloc((size_t)deep * n, sizeof(real)), *weight = malloc(n * sizeof(real)), *likely = malloc(n * sizeof(real));
    real *celsius = malloc(n * sizeof(real)), *permille = malloc(n * sizeof(real));
    int *flags = calloc((size_t)INTS * n, sizeof(int)), *of = malloc(n * sizeof(int));
    uint32_t *random = malloc(n * sizeof(uint32_t));
    uint64_t *recent = calloc(n, 8), *older = calloc(n, 8), *spare = malloc(n * 8);
    int reading = 0, slots = 0, failed = 1;
    if (!state || !ring || !decided || !weight || !likely || !celsius || !permille || !flags || !of || !random || !recent || !older || !spare)
        goto out;
    failed = 0;
    begin(p, state, flags, random, hot_c, shank_c);
    EACH weight[i] = 1.0f / n;
    for (int step = 0; step < p->steps; step++) {
        if (step == from)
            memset(FLAGS(CLOCK), 0, n * sizeof(int));
        if (!(step & 1))
            contacts(p, state, flags, random, weight, step);
        if (p->plant == FIFTH)
            fifth(p, state, flags, random, ring, step);
        else
            third(p, state, flags, random, ring, decided, step);
        if (step >= from && (step - from) % p->slot == p->slot - 1) {
            EACH {
                int inside = FLAGS(INSIDE)[i] && p->kind_of[FLAGS(EVENT)[i]] == 0;
                older[i] = older[i] << 1 | recent[i] >> 63;
                recent[i] = recent[i] << 1 | (uint64_t)inside;
            }
            if (slots >= KEPT)
                tell(p, recent, older, weight, KEPT, slots - KEPT);
            slots++;
        }
        if (reading >= p->readings)
            continue;
        if (step == p->first[reading]) {
            memcpy(celsius, ROW(TOLD_C), n * sizeof(real));
            memcpy(permille, ROW(TOLD_P), n * sizeof(real));
        }
        if (step != p->second[reading])
            continue;
        memset(likely, 0, n * sizeof(real));
        weigh(p, celsius, permille, reading, p->first_share, likely);
        weigh(p, ROW(TOLD_C), ROW(TOLD_P), reading, 1 - p->first_share, likely);
        real sum = 0, squares = 0, mean_c = 0, mean_p = 0;
        EACH mean_c += weight[i] * celsius[i], mean_p += weight[i] * permille[i];
        p->foretold_c[reading] = mean_c, p->foretold_p[reading] = mean_p;
        EACH sum += weight[i] *= likely[i] + 1e-12f;
        EACH weight[i] /= sum, squares += weight[i] * weight[i];
        reading++;
        if (2 > n * squares) /* half of the particles still count */
            continue;
        resampled(n, weight, random, of);
        copy(state, spare, of, REALS, n, 4), copy(ring, spare, of, size, n, 4), copy(decided, spare, of, deep, n, 4);
        copy(flags, spare, of, INTS, n, 4), copy(recent, spare, of, 1, n, 8), copy(older, spare, of, 1, n, 8);
        EACH weight[i] = 1.0f / n;
        spread(n, state, random);
    }
    for (int ago = KEPT < slots ? KEPT - 1 : slots - 1; ago >= 0; ago--)
        tell(p, recent, older, weight, ago, slots - 1 - ago);
out:
    free(state), free(ring), free(decided), free(weight), free(likely), free(celsius), free(permille);
    free(flags), free(of), free(random), free(recent), free(older), free(spare);
    return failed;
}
