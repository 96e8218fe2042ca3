#include "reader.h"

#include <string.h>

#include "board.h"
#include "switching.h"

namespace coilarray {

Reader::Reader(Hal& hal, const uint8_t* safe, uint8_t count)
    : hal_(hal), converter_(hal), switches_(hal), scanner_(hal, converter_, switches_), safe_count_(count) {
    memcpy(safe_, safe, count);
    plan_.clear(0, 0);
    draft_.clear(0, 0);
}

void Reader::begin() {
    switches_.send(safe_, safe_count_);
    hal_.clear_bus();  // the reset may have come in the middle of a transfer
    converter_.sleep();
    boot_ = hal_.boot_number();
    queue_.push("\n", 1);  // ends whatever the port sent while it started
    last_line_ = hal_.micros() - kHeartbeat;
    beat();
}

void Reader::poll() {
    send();
    keep_lease();  // before the commands: the end of a stream is told before a new one begins
    receive();
    scan();
    beat();
}

uint32_t Reader::idle_time() {
    const uint32_t now = hal_.micros();
    uint32_t idle = kHeartbeat - elapsed(now, last_line_);
    if (idle > kHeartbeat) {
        idle = 0;
    }
    if (!queue_.empty()) {
        const uint32_t port = hal_.send_wait();
        idle = port < idle ? port : idle;
    }
    if (!queue_.has_room()) {
        return hal_.send_wait();  // nothing else goes on
    }
    if (ending_ != End::kNone || scanner_.done()) {
        return 0;
    }
    if (scanner_.running()) {
        const uint32_t look = scanner_.idle_time(now);
        idle = look < idle ? look : idle;
    } else if (streaming_) {
        const uint32_t start = elapsed(next_start_, now);
        idle = start < idle ? start : idle;
    }
    if (streaming_) {
        const uint32_t used = elapsed(now, last_command_);
        const uint32_t lease = used < kLease ? kLease - used : 0;
        idle = lease < idle ? lease : idle;
    }
    return idle;
}

// ---------------------------------------------------------------------------------------------- lines to the computer

void Reader::send() {
    if (!queue_.empty() && hal_.send_wait() == 0) {
        hal_.send(queue_.pop());  // one byte: some ports have no buffer and wait until the one before is out
    }
}

void Reader::emit(Text& line) {
    queue_.push(line.data(), line.length());
    last_line_ = hal_.micros();
}

void Reader::beat() {
    if (elapsed(hal_.micros(), last_line_) < kHeartbeat || !queue_.has_room()) {
        return;
    }
    line_.clear();
    line_.add('H');
    line_.add_hex(boot_, 8);
    line_.add(',');
    line_.add_hex(hal_.micros(), 8);
    line_.add(',');
    line_.add_hex(hash(), 4);
    line_.add(',');
    line_.add(mode());
    line_.seal();
    emit(line_);
}

void Reader::add_scan(Text& line, uint32_t sequence) const {
    line.add_hex(sequence, 8);
    line.add(',');
    line.add_hex(scanner_.started(), 8);
    line.add(',');
    line.add_hex(hash_, 4);
    line.add(',');
    line.add_hex(boot_, 8);
    for (uint8_t i = 0; i < plan_.states; ++i) {
        const Sample& sample = scanner_.sample(i);
        line.add(',');
        if (sample.fault != Fault::kNone) {
            line.add('!');
            line.add_hex(static_cast<uint32_t>(sample.fault), 1);
            continue;
        }
        line.add_hex(sample.msb, 4);
        line.add_hex(sample.lsb, 4);
        if (sample.status != 0x0048) {
            line.add('.');
            line.add_hex(sample.status, 4);
        }
        if (plan_.own_drive()) {
            line.add(':');
            line.add_hex(sample.drive, 4);
        }
    }
}

// ------------------------------------------------------------------------------------------------- scans and the lease

void Reader::scan() {
    if (scanner_.done()) {
        finish_scan();
    } else if (scanner_.running()) {
        scanner_.step();
    } else if (streaming_) {
        const uint32_t now = hal_.micros();
        if (elapsed(next_start_, now) == 0) {
            scanner_.start(plan_, now);
            next_start_ += interval_;
            if (elapsed(now, next_start_) > 0 || interval_ == 0) {
                next_start_ = now;  // as fast as it goes; what was missed is not made up
            }
        }
    }
}

void Reader::finish_scan() {
    if (!queue_.has_room()) {
        return;  // the computer does not keep up
    }
    scanner_.take();
    if (streaming_) {
        line_.clear();
        line_.add('S');
        add_scan(line_, sequence_++);
        line_.seal();
        emit(line_);
    } else {
        scan_requested_ = false;
        const bool last = id_ == scan_id_ && !has_reply_;  // no other command came since
        Text& reply = last ? reply_ : line_;
        reply.clear();
        reply.add('<');
        reply.add_hex(scan_id_, 2);
        reply.add(",OK,");
        add_scan(reply, 0);
        reply.seal();
        has_reply_ = true;
        emit(reply);
    }
    switch (scanner_.outcome()) {
        case Outcome::kGood:
            break;
        case Outcome::kConverterReset:
            end_stream(End::kConverterReset);
            break;
        case Outcome::kBusFault:
            end_stream(End::kBusFault);
            converter_.recover();
            break;
        case Outcome::kSwitchesDiffer:
            end_stream(End::kSwitchesDiffer);
            break;
    }
    if (scanner_.outcome() != Outcome::kGood) {
        forget_plan();
    }
}

void Reader::end_stream(End end) {
    if (streaming_) {
        ending_ = end;
        ended_hash_ = hash_;
    }
    rest();
}

void Reader::keep_lease() {
    if (streaming_ && elapsed(hal_.micros(), last_command_) >= kLease) {
        end_stream(End::kLease);
    }
    if (ending_ == End::kNone || !queue_.has_room()) {
        return;
    }
    static const char* const kTexts[] = {"", "lease ended", "converter was reset", "bus fault", "switches differ"};
    line_.clear();
    line_.add('E');
    line_.add_hex(static_cast<uint32_t>(ending_), 1);
    line_.add(',');
    line_.add_hex(ended_hash_, 4);
    line_.add(',');
    line_.add_hex(boot_, 8);
    line_.add(',');
    line_.add(kTexts[static_cast<uint8_t>(ending_)]);
    line_.seal();
    ending_ = End::kNone;
    emit(line_);
}

bool Reader::rest() {
    scanner_.abandon();
    streaming_ = false;
    scan_requested_ = false;
    bool asleep = converter_.sleep() == Transfer::kDone;
    if (!asleep) {
        hal_.clear_bus();
        asleep = converter_.sleep() == Transfer::kDone;
    }
    switches_.send(safe_, safe_count_);  // also with a converter that does not answer
    return asleep;
}

void Reader::forget_plan() {
    configured_ = false;
    scanner_.forget_failures();
}

// ----------------------------------------------------------------------------------------------------------- commands

struct Reader::Command {
    const char* verb;
    uint8_t arguments;
    bool any_time;  // also while a scan or a stream is under way
    Error (Reader::*run)(Fields&);
};

void Reader::receive() {
    for (uint8_t i = 0; i < kBytesAtOnce && queue_.has_room(); ++i) {
        const int byte = hal_.receive();
        if (byte < 0) {
            return;
        }
        if (receiver_.take(static_cast<uint8_t>(byte))) {
            obey();
            return;
        }
    }
}

void Reader::obey() {
    const char* text = receiver_.text();
    uint32_t id = 0;
    Fields fields(text + 1);
    if (text[0] != '>' || fields.commas() == 0 || !fields.hex(2, id)) {
        receiver_.count_dropped();
        return;
    }
    last_command_ = hal_.micros();
    if (has_command_ && id == id_ && receiver_.crc() == crc_) {
        if (has_reply_) {
            emit(reply_);
        }
        return;
    }
    id_ = static_cast<uint8_t>(id);
    crc_ = receiver_.crc();
    has_command_ = true;
    has_reply_ = false;
    dispatch(fields);
}

void Reader::dispatch(Fields& fields) {
    static const Command kCommands[] = {
        {"HELLO", 0, true, &Reader::hello},
        {"BEGIN", 2, true, &Reader::begin_draft},
        {"WIRE", 2, false, &Reader::wire},
        {"SAFE", 1, false, &Reader::safe},
        {"REG", 2, false, &Reader::set_register},
        {"WAIT", 4, false, &Reader::wait},
        {"STATE", 3, false, &Reader::state},
        {"COMMIT", 1, false, &Reader::commit},
        {"SCAN", 0, false, &Reader::scan_once},
        {"START", 1, false, &Reader::start},
        {"STOP", 0, true, &Reader::stop},
        {"PING", 0, true, &Reader::ping},
        {"PEEK", 1, false, &Reader::peek},
        {"CHAIN", 0, false, &Reader::chain},
    };
    const uint8_t arguments = fields.commas();
    why_.clear();
    for (const Command& command : kCommands) {
        if (!fields.is(command.verb)) {
            continue;
        }
        if (arguments != command.arguments) {
            why_.add("wrong number of arguments");
            return answer(Error::kBadArgument);
        }
        if (!command.any_time && active()) {
            return answer(Error::kBusy);
        }
        reply_.clear();
        reply_.add('<');
        reply_.add_hex(id_, 2);
        reply_.add(",OK");
        const Error error = (this->*command.run)(fields);
        return answer(error);
    }
    answer(Error::kUnknownVerb);
}

// Where the command says nothing itself.
static const char* const kMeanings[] = {
    "", "unknown verb", "bad argument", "no draft", "illegal switching",
    "hash differs", "bus fault", "read-back differs", "another chip", "a scan or a stream is under way",
};

void Reader::answer(Error error) {
    if (error == Error::kNone && scan_requested_ && scan_id_ == id_) {
        return;  // the reply to SCAN is its result
    }
    if (error != Error::kNone) {
        reply_.clear();
        reply_.add('<');
        reply_.add_hex(id_, 2);
        reply_.add(",ERR,");
        reply_.add_hex(static_cast<uint32_t>(error), 1);
        reply_.add(',');
        why_.add('\0');
        reply_.add(why_.data()[0] == '\0' ? kMeanings[static_cast<uint8_t>(error)] : why_.data());
    }
    reply_.seal();
    has_reply_ = true;
    emit(reply_);
}

Error Reader::hello(Fields&) {
    rest();
    uint16_t manufacturer = 0, device = 0;
    if (converter_.read(kManufacturerId, manufacturer) != Transfer::kDone ||
        converter_.read(kDeviceId, device) != Transfer::kDone) {
        manufacturer = device = 0;
    }
    reply_.add(',');
    reply_.add(kProtocol);
    reply_.add(',');
    reply_.add(kFirmware);
    reply_.add(',');
    reply_.add_hex(boot_, 8);
    reply_.add(',');
    reply_.add_hex(manufacturer, 4);
    reply_.add(',');
    reply_.add_hex(device, 4);
    reply_.add(',');
    reply_.add_decimal(kMostStates);
    reply_.add(',');
    reply_.add_decimal(kMostDevices);
    reply_.add(switches_.wired_back() ? ",readback" : ",-");
    return Error::kNone;
}

Error Reader::begin_draft(Fields& fields) {
    uint32_t devices = 0, states = 0;
    if (!fields.hex(2, devices) || !fields.hex(2, states)) {
        return Error::kBadArgument;
    }
    if (devices < 1 || devices > kMostDevices || states < 1 || states > kMostStates) {
        why_.add("too many or none");
        return Error::kBadArgument;
    }
    drafting_ = true;
    draft_.clear(static_cast<uint8_t>(devices), static_cast<uint8_t>(states));
    return rest() ? Error::kNone : bus_fault("converter not put to sleep");
}

Error Reader::wire(Fields& fields) {
    uint32_t device = 0;
    uint8_t codes[kSwitches];
    if (!drafting_) {
        return Error::kOutOfOrder;
    }
    if (!fields.hex(2, device) || device >= draft_.devices || !fields.bytes(codes, kSwitches)) {
        return Error::kBadArgument;
    }
    memcpy(draft_.wiring[device], codes, kSwitches);
    draft_.has_wiring |= uint32_t{1} << device;
    return Error::kNone;
}

Error Reader::safe(Fields& fields) {
    uint8_t words[kMostDevices];
    if (!drafting_) {
        return Error::kOutOfOrder;
    }
    if (!fields.bytes(words, draft_.devices)) {
        return Error::kBadArgument;
    }
    memcpy(draft_.safe, words, draft_.devices);
    draft_.has_safe = true;
    return Error::kNone;
}

Error Reader::set_register(Fields& fields) {
    uint32_t address = 0, value = 0;
    if (!drafting_) {
        return Error::kOutOfOrder;
    }
    if (!fields.hex(2, address) || !fields.hex(4, value)) {
        return Error::kBadArgument;
    }
    const int8_t index = register_index(static_cast<uint8_t>(address));
    if (index < 0 || !register_allowed(static_cast<uint8_t>(address), static_cast<uint16_t>(value))) {
        why_.add(index < 0 ? "another register" : "a value that the register must not have");
        return Error::kBadArgument;
    }
    draft_.registers[index] = static_cast<uint16_t>(value);
    draft_.has_register = static_cast<uint8_t>(draft_.has_register | 1 << index);
    return Error::kNone;
}

Error Reader::wait(Fields& fields) {
    uint32_t wait = 0, timeout = 0, discard = 0, again = 0;
    if (!drafting_) {
        return Error::kOutOfOrder;
    }
    if (!fields.hex(8, wait) || !fields.hex(8, timeout) || wait > timeout || timeout > kLongestTimeout ||
        !fields.hex(2, discard) || discard > kMostDiscarded || !fields.hex(8, again) || again > timeout) {
        return Error::kBadArgument;
    }
    draft_.wait = wait;
    draft_.timeout = timeout;
    draft_.discard = static_cast<uint8_t>(discard);
    draft_.again = again;
    draft_.has_times = true;
    return Error::kNone;
}

Error Reader::state(Fields& fields) {
    uint32_t index = 0, drive = 0;
    uint8_t words[kMostDevices];
    if (!drafting_) {
        return Error::kOutOfOrder;
    }
    if (!fields.hex(2, index) || index >= draft_.states || !fields.bytes(words, draft_.devices) ||
        !fields.hex(4, drive) || (drive & 0x07FF) != 0) {
        return Error::kBadArgument;
    }
    State& state = draft_.state[index];
    memcpy(state.words, words, draft_.devices);
    state.drive = static_cast<uint16_t>(drive);
    draft_.has_state |= uint32_t{1} << index;
    return Error::kNone;
}

Error Reader::commit(Fields& fields) {
    uint32_t hash = 0;
    if (!drafting_) {
        return Error::kOutOfOrder;
    }
    if (!fields.hex(4, hash)) {
        return Error::kBadArgument;
    }
    drafting_ = false;
    forget_plan();
    Error error = check_draft(hash);
    if (error == Error::kNone) {
        error = check_identity();
    }
    if (error == Error::kNone) {
        error = program();
    }
    if (error != Error::kNone) {
        return error;
    }
    plan_ = draft_;
    hash_ = static_cast<uint16_t>(hash);
    configured_ = true;
    reply_.add(',');
    reply_.add_hex(hash_, 4);
    return Error::kNone;
}

Error Reader::check_draft(uint32_t hash) {
    if (!draft_.complete()) {
        why_.add("draft incomplete");
        return Error::kHashDiffers;
    }
    if (draft_.hash() != hash) {
        why_.add("hash of the draft is ");
        why_.add_hex(draft_.hash(), 4);
        return Error::kHashDiffers;
    }
    if (draft_.own_drive() && draft_.states > kMostOwnDrives) {
        why_.add("too many states with RP_OVERRIDE_EN 0");
        return Error::kBadArgument;
    }
    if (!legal(draft_, why_)) {
        return Error::kIllegalSwitching;
    }
    why_.clear();
    return Error::kNone;
}

Error Reader::check_identity() {
    uint16_t manufacturer = 0, device = 0;
    if (converter_.read(kManufacturerId, manufacturer) != Transfer::kDone ||
        converter_.read(kDeviceId, device) != Transfer::kDone) {
        return bus_fault("converter does not answer");
    }
    if (manufacturer != kManufacturer || device != kDevice) {
        why_.add_hex(manufacturer, 4);
        why_.add(' ');
        why_.add_hex(device, 4);
        return Error::kOtherChip;
    }
    return Error::kNone;
}

Error Reader::program() {
    converter_.set_active_config(draft_.registers[kConfigIndex]);
    if (converter_.sleep() != Transfer::kDone) {
        return bus_fault("converter not put to sleep");
    }
    memcpy(safe_, draft_.safe, draft_.devices);
    safe_count_ = draft_.devices;
    switches_.send(safe_, safe_count_);
    if (!switches_.send(safe_, safe_count_)) {
        why_.add("switches");
        return Error::kReadBackDiffers;
    }
    for (uint8_t i = 0; i < kRegisters; ++i) {
        const uint8_t address = kRegisterAddresses[i];
        uint16_t value = draft_.registers[i], found = 0;
        if (i == kConfigIndex) {
            value |= kAsleep;
        }
        if (converter_.write(address, value) != Transfer::kDone || converter_.read(address, found) != Transfer::kDone) {
            return bus_fault("register not written");
        }
        if (found != value) {
            why_.add("register ");
            why_.add_hex(address, 2);
            why_.add(" is ");
            why_.add_hex(found, 4);
            return Error::kReadBackDiffers;
        }
    }
    return Error::kNone;
}

Error Reader::bus_fault(const char* text) {
    hal_.clear_bus();
    why_.add(text);
    return Error::kBusFault;
}

Error Reader::scan_once(Fields&) {
    if (!configured_) {
        why_.add("not configured");
        return Error::kOutOfOrder;
    }
    scan_requested_ = true;
    scan_id_ = id_;
    scanner_.start(plan_, hal_.micros());
    return Error::kNone;
}

Error Reader::start(Fields& fields) {
    uint32_t interval = 0;
    if (!fields.hex(8, interval) || interval > kLongestInterval) {
        return Error::kBadArgument;
    }
    if (!configured_) {
        why_.add("not configured");
        return Error::kOutOfOrder;
    }
    interval_ = interval;
    sequence_ = 0;
    next_start_ = hal_.micros();
    scanner_.forget_failures();
    streaming_ = true;
    return Error::kNone;
}

Error Reader::stop(Fields&) {
    return rest() ? Error::kNone : bus_fault("converter not put to sleep");
}

Error Reader::ping(Fields&) {
    reply_.add(',');
    reply_.add_hex(boot_, 8);
    reply_.add(',');
    reply_.add_hex(hal_.micros(), 8);
    reply_.add(',');
    reply_.add(mode());
    reply_.add(',');
    reply_.add_decimal(receiver_.dropped());
    return Error::kNone;
}

Error Reader::peek(Fields& fields) {
    uint32_t address = 0;
    uint16_t value = 0;
    if (!fields.hex(2, address)) {
        return Error::kBadArgument;
    }
    if (converter_.read(static_cast<uint8_t>(address), value) != Transfer::kDone) {
        return bus_fault("converter does not answer");
    }
    reply_.add(',');
    reply_.add_hex(value, 4);
    return Error::kNone;
}

Error Reader::chain(Fields&) {
    switches_.send(safe_, safe_count_);
    const bool same = switches_.send(safe_, safe_count_);
    reply_.add(!switches_.wired_back() ? ",none" : same ? ",same" : ",differ");
    return Error::kNone;
}

}  // namespace coilarray
